"""The page: who may come in, what it says, and the whole of it in a real browser, stopped under load."""

import asyncio
import contextlib
import json
import multiprocessing
import re
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urlsplit

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("aiohttp")
from aiohttp import WSServerHandshakeError
from aiohttp.test_utils import TestClient, TestServer

from optid.errors import InputError
from optid.live.events import Events
from optid.live.loop import ORDERS, Choices
from optid.live.page.access import ADDRESSES, PAUSE, PROTOCOL, WRONG, Access, FailedAttempts
from optid.live.page.server import CONNECTIONS, FILES, READERS, Page, served
from optid.live.plan import SIGNALS, slow_columns
from optid.live.ring_buffer import RingBuffer
from optid.live.settings import live_settings, wiring_of
from optid.pid.controller import Gains


@pytest.fixture
def session(bench):
    """What a page needs of a session, without one."""
    orders, gains = [], Gains(20.0)

    def demand(text):
        if "mm" not in text:
            raise InputError("not like that", field="reference")
        orders.append(text)

    made = SimpleNamespace(
        plan=SimpleNamespace(driver="simulated", choices=Choices(gains), out=Path("out")),
        rig_name="bench",
        gains=gains,
        settings=live_settings(bench),
        wiring=wiring_of(bench),
        events=Events(),
        end=None,
        disagree=False,
        hides="a leak",
        demanded="",
        following=SimpleNamespace(standing=None),
        diagnosis="",
        busy=False,
        applicable=False,
        tuning=SimpleNamespace(review=None),
        signals=RingBuffer(1000, len(SIGNALS)),
        slow=RingBuffer(50, len(slow_columns(ORDERS))),
        orders=orders,
        stop=lambda why: orders.append(why),
        tune=lambda: orders.append("tune"),
        apply=lambda confirmed: orders.append(("apply", confirmed)),
        demand=demand,
    )
    yield made
    made.signals.close()
    made.slow.close()


def with_client(session, access, job):
    """Run a coroutine against the page's server."""

    async def run():
        page = Page(session, access)
        async with TestClient(TestServer(page.application())) as client:
            await job(client)

    asyncio.run(run())


def test_the_page_needs_nothing_from_elsewhere(session):
    async def job(client):
        for path in FILES:
            answer = await client.get(path)
            text = await answer.text()
            assert answer.status == 200
            assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
            assert not re.search(r"https?://", text), path
        assert (await client.get("/recording.csv")).status == 404

    with_client(session, Access(), job)


def bearing(token):
    return {"Authorization": f"Bearer {token}"}


def test_on_loopback_other_names_and_other_sites_are_turned_away(session):
    async def job(client):
        assert (await client.get("/", headers={"Host": "evil.example:80"})).status == 403
        own = bearing(access.token)
        assert (await client.get("/live", headers={"Origin": "http://evil.example", **own})).status == 403
        assert (await client.get("/")).status == 200

    with_client(session, access := Access(), job)


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_only_the_token_opens_on_this_machine_too(session, host):
    async def job(client):
        assert (await client.get("/")).status == 200  # the page is no secret, and can show nothing
        assert (await client.get("/live")).status == 403
        assert (await client.get("/live", headers=bearing("wrong"))).status == 403
        assert (await client.get("/live?token=open+sesame")).status == 403  # an address is told to others
        with pytest.raises(WSServerHandshakeError):
            await client.ws_connect("/live", protocols=(PROTOCOL, b"wrong".hex()))
        async with client.ws_connect("/live", protocols=(PROTOCOL, b"open sesame".hex())) as socket:
            assert socket.protocol == PROTOCOL  # and not the token
            assert (await heard(socket))["kind"] == "hello"
        async with client.ws_connect("/live", headers=bearing("open sesame")) as socket:
            assert (await heard(socket))["kind"] == "hello"

    with_client(session, Access(host, token="open sesame"), job)


def test_what_is_served_where():
    assert Access().local and Access("localhost").local and Access("::1").local
    assert not Access("0.0.0.0").local and not Access("rig.example").local
    assert Access("rig.example", token="a c").url(80) == "http://rig.example:80/#token=a%20c"
    assert Access().token != Access().token
    assert Access(token="abc").url(8000) == "http://127.0.0.1:8000/#token=abc"
    assert "abc" not in repr(Access(token="abc"))


def test_after_too_many_wrong_tokens_an_address_waits(session):
    async def job(client):
        for _ in range(WRONG):
            assert (await client.get("/live", headers=bearing("wrong"))).status == 403
        answer = await client.get("/live", headers=bearing(access.token))
        assert answer.status == 429
        assert 0 < int(answer.headers["Retry-After"]) <= PAUSE
        assert [event.words for event in session.events] == [
            "the page: too many wrong tokens from 127.0.0.1; further attempts are delayed"
        ]

    with_client(session, access := Access(), job)


def test_who_waited_may_try_again_and_others_need_not_wait():
    now = 0.0
    attempts = FailedAttempts(lambda: now)
    for _ in range(WRONG):
        attempts.wrong("one")
        now += 1.0
    assert attempts.wait("one") == pytest.approx(PAUSE - 1.0)
    assert attempts.wait("other") == 0.0
    now += PAUSE
    assert attempts.wait("one") == 0.0
    for number in range(10_000):
        attempts.wrong(str(number))
    assert len(attempts._seen) == ADDRESSES


def with_gate(session, job, monkeypatch, header_time):
    """Run a coroutine against the page as it is served."""
    monkeypatch.setattr("optid.live.page.server.HEADER_TIME", header_time)
    access = Access()

    async def run():
        page = Page(session, access)
        async with served(page, access, access.listen()) as address:
            await job(urlsplit(address).port)

    asyncio.run(run())


def test_who_says_nothing_is_cut_off_in_time(session, monkeypatch):
    async def job(port):
        silent, slow, prompt = [await asyncio.open_connection("127.0.0.1", port) for _ in range(3)]
        slow[1].write(b"GET / HTTP/1.1\r\nHost: 127.0.0.1")
        prompt[1].write(b"GET / HTTP/1.1\r\nHost: 127.0.0.1:1\r\n\r\n")
        assert (await prompt[0].readline()).split()[1] == b"200"
        for reader, writer in (silent, slow):
            with contextlib.suppress(ConnectionError):
                assert await asyncio.wait_for(reader.read(), 5.0) == b""
            writer.close()
        prompt[1].close()

    with_gate(session, job, monkeypatch, 0.3)


def test_only_so_many_connections(session, monkeypatch):
    async def job(port):
        held = []
        for _ in range(CONNECTIONS):
            held.append(await asyncio.open_connection("127.0.0.1", port))
            await asyncio.sleep(0.002)
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        with contextlib.suppress(ConnectionError):
            assert await asyncio.wait_for(reader.read(), 5.0) == b""
        for one in [*held, (reader, writer)]:
            one[1].close()

    with_gate(session, job, monkeypatch, 60.0)


async def heard(socket, binary=False):
    """The next message of a kind."""
    while True:
        message = await asyncio.wait_for(socket.receive(), 30)
        if binary and isinstance(message.data, bytes):
            return np.frombuffer(message.data).reshape(-1, len(SIGNALS))
        if not binary and isinstance(message.data, str):
            return json.loads(message.data)


def test_a_reader_hears_what_stays_then_what_is_new(session):
    async def job(client):
        for n in range(2000):  # twice the ring
            session.signals.add((float(n), *(0.0,) * (len(SIGNALS) - 1)))
        session.events.note("something")
        async with client.ws_connect("/live", headers=bearing(access.token)) as socket:
            first = await heard(socket)
            assert (first["kind"], first["signals"], first["limits"]["high"]) == ("hello", list(SIGNALS), 5.0)
            rows = await heard(socket, binary=True)
            assert first["hides"] == "a leak"
            assert rows[-1, 0] >= 1996
            assert np.all(np.diff(rows[:, 0]) == 4)  # 250 of 1000 a second
            said = await heard(socket)
            assert said["events"][0][1] == "something"
            for n in range(2000, 2100):
                session.signals.add((float(n), *(0.0,) * (len(SIGNALS) - 1)))
            later = await heard(socket, binary=True)
            assert later[0, 0] == rows[-1, 0] + 4  # without a gap
            for wish in ("tune", "apply", "stop", "nonsense"):
                await socket.send_str(json.dumps({"do": wish}))
            await socket.send_str(json.dumps({"do": "apply", "confirmed": True}))
            await socket.send_str("{no json")
            await socket.send_str("[]")
            await socket.send_str(json.dumps({"do": "reference", "text": "60 mm"}))
            await socket.send_str(json.dumps({"do": "reference", "text": "60"}))
            while (said := await heard(socket))["kind"] != "answer":
                pass
            assert "not like that" in said["words"]
            session.end = {"how": "stopped", "why": "the Stop button of the page"}
            while (said := await heard(socket))["end"] is None:
                pass
            assert said["end"]["why"] == "the Stop button of the page"
        assert session.orders == [
            "tune",
            ("apply", False),
            "the Stop button of the page",
            ("apply", True),
            "60 mm",
        ]

    with_client(session, access := Access(), job)


def test_only_so_many_readers(session):
    async def job(client):
        own = bearing(access.token)
        sockets = [await client.ws_connect("/live", headers=own) for _ in range(READERS)]
        assert (await client.get("/live", headers=own)).status == 503
        for socket in sockets:
            await socket.close()
        again = await client.ws_connect("/live", headers=own)
        assert (await heard(again))["kind"] == "hello"
        await again.close()

    with_client(session, access := Access(), job)


def test_what_happens_while_a_message_leaves_is_in_the_next_one(session):
    class Slow:
        closed, heard = False, []

        async def send_str(self, text):
            if "events" not in (message := json.loads(text)):
                return
            self.heard.append([words for _, words in message["events"]])
            if len(self.heard) == 1:
                session.events.note("applied")  # the session goes on while the network takes its time
            self.closed = len(self.heard) == 3

    async def listen():
        socket = Slow()
        await asyncio.wait_for(Page(session, Access())._feed(socket), 5)
        return socket.heard

    assert asyncio.run(listen()) == [[], ["applied"], []]


# In a browser.


def burn():
    while True:
        pass


@pytest.fixture
def browser():
    """A headless browser that is on this machine."""
    playwright = pytest.importorskip("playwright.sync_api")
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if path is None:
        pytest.skip("no Chromium on this machine")
    with playwright.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture
def address(session):
    """The page of a session that stands still, served by a thread of its own."""
    access, ready, over = Access(), threading.Event(), threading.Event()
    found = []

    async def serve():
        async with served(Page(session, access), access, access.listen()) as url:
            found.append(url)
            ready.set()
            while not over.is_set():
                await asyncio.sleep(0.02)
            session.end = {"how": "stopped", "why": "by the test"}

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    assert ready.wait(30)
    yield found[0]
    over.set()
    thread.join()


def add(session, page, begin, end, size):
    """Samples at 1 kHz, in pieces that the page has had: a reference that steps every second, and a position."""
    for piece in np.arange(begin, end, 0.25):
        add_at_once(session, piece, min(piece + 0.25, end), size)
        until(
            page,
            f"page.signals && page.signals.at(page.signals.length - 1, 0) > {min(piece + 0.25, end) - 0.01}",
        )


def add_at_once(session, begin, end, size):
    for n in range(round(1e3 * begin), round(1e3 * end)):
        r = size * (n // 1000 % 2)
        y = r * (1 - np.exp(-(n % 1000) / 50))
        session.signals.add((n / 1e3, r, y, y, 0.9 * y, y, 0.1, 0.0))


def test_what_an_operator_does_on_the_page(browser, address, session, tmp_path):
    page = browser.new_page(viewport={"width": 1600, "height": 1000})
    complaints = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(address)
    add(session, page, 0, 1.0, 0.05)
    until(page, "page.signals && page.charts[0].scale.high > 0")
    assert "token" not in page.url  # nobody reads it off the screen
    assert "It differs from the rig file in: a leak." in page.inner_text("#hides")
    # A bare number is in the unit of the axis; what cannot be done is said.
    page.fill("#wish", "60")
    page.press("#wish", "Enter")
    page.fill("#wish", "5 kg")
    page.press("#wish", "Enter")
    until(page, "document.getElementById('answer').textContent.includes('not like that')")
    page.set_input_files(
        "#profile", {"name": "p.csv", "mimeType": "text/csv", "buffer": b"t,x\n0,10\n1.5;-20\n"}
    )
    until(page, "document.getElementById('wish').value !== '5 kg'")
    page.evaluate("document.activeElement.blur()")
    for _ in range(100):
        if len(session.orders) == 2:
            break
        page.wait_for_timeout(20)
    assert session.orders == ["60 mm", "0:10 mm, 1.5:-20 mm"]
    # Scales are steady: smaller moves leave the axis as it is.
    for second in range(1, 4):
        add(session, page, second, second + 1, 0.05 if second == 1 else 0.01)
        page.wait_for_timeout(60)
        if second == 1:
            scale = page.evaluate("[page.charts[0].scale.low, page.charts[0].scale.high]")
    assert scale[1] > 50.0
    assert page.evaluate("[page.charts[0].scale.low, page.charts[0].scale.high]") == scale
    # The last step, held still while samples come.
    page.keyboard.press("s")
    until(page, "view.held !== null")
    shown = page.evaluate("[view.end - view.span, view.end]")
    assert shown == pytest.approx([2.9, 4.4], abs=0.01)
    add(session, page, 4, 4.3, 0.05)
    assert page.evaluate("[view.end - view.span, view.end]") == shown
    # A drag zooms, the pointer reads values off.
    box = page.locator("#position").bounding_box()
    x, y = (lambda share: box["x"] + share * box["width"]), box["y"] + 100
    page.mouse.move(x(0.2), y)
    page.mouse.down()
    page.mouse.move(x(0.4), y, steps=4)
    page.mouse.up()
    until(page, "view.span < 0.5 && Number.isFinite(view.cursor)")
    with page.expect_download() as download:
        page.click("#table")
    download.value.save_as(tmp_path / "view.csv")
    table = pd.read_csv(tmp_path / "view.csv")
    assert list(table.columns[:3]) == ["time_s", "reference_mm", "real_mm"]
    assert 50 < len(table) < 130  # what is shown, 250 a second
    np.testing.assert_allclose(table["reference_mm"], np.where(table["time_s"] >= 3.0, 10.0, 0.0), atol=1e-9)
    with page.expect_download() as download:
        page.click("#picture")
    download.value.save_as(tmp_path / "view.png")
    assert (tmp_path / "view.png").read_bytes()[:4] == b"\x89PNG"
    # Back to the newest, and large.
    page.keyboard.press("0")
    until(page, "view.held === null")
    page.keyboard.press("w")
    until(page, "page.charts[0].size >= 26")  # pixels: half of 14 mm on a screen of 96 to the inch
    assert (
        page.evaluate("parseFloat(getComputedStyle(document.getElementById('read-measured')).fontSize)") >= 52
    )
    assert page.evaluate("document.documentElement.scrollHeight <= window.innerHeight")
    assert complaints == []


@pytest.mark.parametrize("fragment", ["", "#token=wrong"])
def test_a_browser_without_the_token_sees_nothing(browser, address, session, fragment):
    add_at_once(session, 0, 0.5, 0.05)
    page = browser.new_page()
    page.goto(address.split("#")[0] + fragment)
    until(page, "document.getElementById('state').textContent.includes('access refused')")
    assert page.evaluate("page.signals === null")
    assert page.is_disabled("#stop")


@pytest.fixture
def live(tmp_path, patient):
    """The command with a page, and its address."""
    call = [
        sys.executable,
        "-m",
        "optid.cli",
        "live",
        str(patient),
        "--out",
        str(tmp_path / "out"),
        "--rate",
        "250",
        "--gains",
        "kp=8",
        "--page",
        "--fast",
    ]
    with subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        line = process.stdout.readline()
        assert line.startswith("the page: "), line + process.stdout.read()
        yield SimpleNamespace(process=process, url=line.split()[-1], out=tmp_path / "out")
        if process.poll() is None:
            process.kill()


DRAWN = """id => {
  const c = document.getElementById(id), data = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
  let dark = 0; for (let i = 3; i < data.length; i += 4) if (data[i]) dark++; return dark; }"""


def until(page, expression):
    """Wait for it; the page's own policy forbids the browser to be handed a function that waits."""
    for _ in range(6000):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(50)
    raise AssertionError(f"not in five minutes: {expression}; {page.inner_text('#events')}")


@pytest.mark.full
def test_the_whole_page_by_keyboard_and_a_stop_under_load(browser, live):
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    complaints = []
    # Chromium's advice on reading a canvas back is about DRAWN above, which the page never does
    page.on(
        "console",
        lambda message: None if "willReadFrequently" in message.text else complaints.append(message.text),
    )
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.set_default_timeout(60_000)
    page.goto(live.url)
    until(page, "page.signals && page.time(page.signals.length - 1) > 10.0")  # s of the session
    for chart in ("position", "command", "mismatch", "residual", "theta"):
        until(page, f"({DRAWN})('{chart}') > 500")
    before = page.inner_text("#gains")
    page.keyboard.press("t")
    until(page, "/tuned:/.test(document.getElementById('events').textContent)")  # or "not tuned:"
    assert "ITAE" in page.inner_text("#verdict"), page.inner_text("#events")
    until(page, f"({DRAWN})('review') > 500")
    assert page.is_enabled("#apply")
    page.keyboard.press("a")  # goes there and does no more
    assert page.evaluate("document.activeElement.id") == "apply"
    assert "applied:" not in page.inner_text("#events")
    page.keyboard.press("Enter")
    until(page, "document.getElementById('events').textContent.includes('applied:')")
    until(page, "document.getElementById('apply').disabled")
    until(page, f"document.getElementById('gains').innerText !== {json.dumps(before)}")
    load = [multiprocessing.get_context("spawn").Process(target=burn, daemon=True) for _ in range(4)]
    for process in load:
        process.start()
    try:
        page.keyboard.press("Escape")
        until(page, "document.getElementById('state').textContent.includes('stop')")
        assert live.process.wait(60) == 0
    finally:
        for process in load:
            process.kill()
            process.join()
    assert page.is_disabled("#stop")
    document = json.loads((live.out / "live.json").read_text())
    assert (document["outcome"], document["why"], document["safe"]) == (
        "stopped",
        "the Stop button of the page",
        True,
    )
    assert any("applied: kp" in event["words"] for event in document["events"])
    assert complaints == []
