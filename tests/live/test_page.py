"""The page: who may come in, what it says, and the whole of it in a real browser, stopped under load."""

import asyncio
import json
import multiprocessing
import re
import shutil
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("aiohttp")
from aiohttp.test_utils import TestClient, TestServer

from optid.live.events import Events
from optid.live.loop import ORDERS, Choices
from optid.live.page.door import Door
from optid.live.page.server import READERS, Page
from optid.live.plan import SIGNALS, slow_columns
from optid.live.ring import Ring
from optid.live.settings import live_settings, wiring_of
from optid.pid.controller import Gains


@pytest.fixture
def session(bench):
    """What a page needs of a session, without one."""
    orders, gains = [], Gains(20.0)
    made = SimpleNamespace(
        plan=SimpleNamespace(driver="simulated", choices=Choices(gains)),
        rig_name="bench",
        gains=gains,
        settings=live_settings(bench),
        wiring=wiring_of(bench),
        events=Events(),
        end=None,
        parted=False,
        diagnosis="",
        busy=False,
        applicable=False,
        tuning=SimpleNamespace(review=None),
        signals=Ring(1000, len(SIGNALS)),
        slow=Ring(50, len(slow_columns(ORDERS))),
        orders=orders,
        stop=lambda why: orders.append(why),
        tune=lambda: orders.append("tune"),
        apply=lambda confirmed: orders.append(("apply", confirmed)),
    )
    yield made
    made.signals.close()
    made.slow.close()


def with_client(session, door, job):
    """Run a coroutine against the page's server."""

    async def run():
        page = Page(session, door)
        async with TestClient(TestServer(page.application())) as client:
            await job(client)

    asyncio.run(run())


def test_the_page_needs_nothing_from_elsewhere(session):
    async def job(client):
        for path in ("/", "/page.js", "/chart.js", "/page.css"):
            answer = await client.get(path)
            text = await answer.text()
            assert answer.status == 200
            assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
            assert not re.search(r"https?://", text), path
        assert (await client.get("/recording.csv")).status == 404

    with_client(session, Door(), job)


def test_on_loopback_other_names_and_other_sites_are_turned_away(session):
    async def job(client):
        assert (await client.get("/", headers={"Host": "evil.example:80"})).status == 403
        assert (await client.get("/live", headers={"Origin": "http://evil.example"})).status == 403
        assert (await client.get("/")).status == 200

    with_client(session, Door(), job)


def test_elsewhere_only_the_token_opens(session):
    async def job(client):
        assert (await client.get("/")).status == 403
        assert (await client.get("/?token=wrong")).status == 403
        assert (await client.get("/live")).status == 403
        answer = await client.get("/?token=open+sesame")
        assert answer.status == 200
        assert "HttpOnly" in answer.headers["Set-Cookie"]
        other = await client.get("/page.js", headers={"Cookie": answer.headers["Set-Cookie"].split(";")[0]})
        assert other.status == 200

    with_client(session, Door("0.0.0.0", token="open sesame"), job)


def test_what_is_served_where():
    assert Door().local and Door("localhost").local and Door("::1").local
    assert not Door("0.0.0.0").local and not Door("rig.example").local
    assert Door().url(8000) == "http://127.0.0.1:8000/"
    assert Door("rig.example", token="abc").url(80) == "http://rig.example:80/?token=abc"
    assert Door("0.0.0.0").token != Door("0.0.0.0").token


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
        async with client.ws_connect("/live") as socket:
            first = await heard(socket)
            assert (first["kind"], first["signals"], first["limits"]["high"]) == ("hello", list(SIGNALS), 5.0)
            rows = await heard(socket, binary=True)
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
            session.end = {"how": "stopped", "why": "the page's stop"}
            while (said := await heard(socket))["end"] is None:
                pass
            assert said["end"]["why"] == "the page's stop"
        assert session.orders == ["tune", ("apply", False), "the page's stop", ("apply", True)]

    with_client(session, Door(), job)


def test_only_so_many_readers(session):
    async def job(client):
        sockets = [await client.ws_connect("/live") for _ in range(READERS)]
        assert (await client.get("/live")).status == 503
        for socket in sockets:
            await socket.close()
        again = await client.ws_connect("/live")
        assert (await heard(again))["kind"] == "hello"
        await again.close()

    with_client(session, Door(), job)


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
        await asyncio.wait_for(Page(session, Door())._feed(socket), 5)
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
    assert (document["outcome"], document["why"], document["safe"]) == ("stopped", "the page's stop", True)
    assert any("applied: kp" in event["words"] for event in document["events"])
    assert complaints == []
