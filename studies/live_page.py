"""The page of `optid live` in a real browser at 1 kHz: is it all there, does it grow, does the loop miss deadlines?

    python studies/live_page.py [--minutes 20] [--rate 1000] [--out DIR]

Starts a session of data/bench.toml with the simulated driver, opens its page in Chromium, sets references, pauses,
zooms, exports and looks at it from afar; keeps pictures in DIR. Then the page stays open until the time is over, and
memory of each process is read every ten seconds: growth is a line's slope over the second half. Needs Chromium and
Linux's /proc.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
EVERY = 10.0  # s between looks at the memory
SIZE = {"width": 1600, "height": 1000}


def memory(process: int) -> int:
    """Resident memory that no other process shares, bytes; 0 where it has ended."""
    try:
        lines = Path(f"/proc/{process}/smaps_rollup").read_text(encoding="utf-8").splitlines()
    except OSError:
        return 0
    return 1024 * sum(int(line.split()[1]) for line in lines if line.startswith("Private_"))


def descendants(process: int) -> list[int]:
    """It and all that it started."""
    found, parents = [process], {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text(encoding="utf-8").rpartition(")")[2].split()
        except OSError:
            continue
        parents[int(stat.parent.name)] = int(fields[1])
    for one in found:
        found += [child for child, parent in parents.items() if parent == one]
    return found


def tour(page: Any, out: Path) -> dict[str, Any]:
    """Use everything once; what was seen."""
    seen: dict[str, Any] = {}

    def until(expression: str, seconds: float = 60.0) -> None:
        end = time.monotonic() + seconds
        while not page.evaluate(expression):
            if time.monotonic() > end:
                raise SystemExit(f"not within {seconds:.0f} s: {expression}")
            page.wait_for_timeout(50)

    def asked(text: str) -> None:
        page.fill("#wish", text)
        page.press("#wish", "Enter")
        page.evaluate("document.activeElement.blur()")

    until("page.signals && page.signals.length > 2000")
    seen["address without the token"] = "token" not in page.url
    seen["hides"] = page.inner_text("#hides")
    page.wait_for_timeout(8000)
    page.screenshot(path=out / "page.png", full_page=True)
    asked("60")
    until("document.getElementById('events').textContent.includes('reference: 60 mm')")
    until("Math.abs(page.factor * page.signals.at(page.signals.length - 1, page.at.reference) - 60) < 1e-6")
    page.wait_for_timeout(2500)
    page.keyboard.press("s")  # the last step, as in figure 14
    page.wait_for_timeout(500)
    page.screenshot(path=out / "step.png")
    before = page.evaluate("[view.end, view.span]")
    page.wait_for_timeout(1500)
    seen["held still"] = page.evaluate("[view.end, view.span]") == before
    box = page.locator("#position").bounding_box()
    page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 100, steps=5)
    page.mouse.up()
    seen["zoomed to s"] = round(page.evaluate("view.span"), 3)
    page.wait_for_timeout(300)
    page.screenshot(path=out / "zoom.png")
    for button, name in (("#table", "view.csv"), ("#picture", "view.png")):
        with page.expect_download() as download:
            page.click(button)
        download.value.save_as(out / name)
    seen["rows exported"] = len((out / "view.csv").read_text(encoding="utf-8").splitlines()) - 1
    page.keyboard.press("0")
    asked("300 mm")
    until("document.getElementById('answer').textContent.includes('stroke')")
    seen["a reference beyond the stroke"] = page.inner_text("#answer")
    asked("sine 40 mm 0.25 Hz")
    page.wait_for_timeout(9000)
    page.keyboard.press("w")
    page.wait_for_timeout(1000)
    page.screenshot(path=out / "wall.png")
    seen["axis in the large view, pixels"] = page.evaluate("page.charts[0].size")
    page.keyboard.press("w")
    scales = []
    for _ in range(30):
        page.wait_for_timeout(100)
        scales.append(tuple(page.evaluate("[page.charts[0].scale.low, page.charts[0].scale.high]")))
    seen["position scales in 3 s"] = len(set(scales))
    asked("tour")
    return seen


def watch(page: Any, session: subprocess.Popen[str], browser: int, end: float) -> dict[str, Any]:
    """Memory until the time is over: first, last and slope, MB."""
    rows = []
    while time.monotonic() < end and session.poll() is None:
        whole = descendants(session.pid)
        heap = page.evaluate("gc(), performance.memory.usedJSHeapSize")
        rows.append(
            (
                time.monotonic(),
                memory(whole[0]),
                sum(map(memory, whole[1:])),
                sum(map(memory, descendants(browser))),
                heap,
            )
        )
        page.wait_for_timeout(1e3 * EVERY)
    table = np.array(rows) / [1.0, *4 * [1e6]]
    names = ("session", "guard, loop and helpers", "browser", "page's heap")
    late = table[len(table) // 2 :]
    found = {}
    for i, name in enumerate(names, 1):
        slope = float(np.polyfit(late[:, 0], late[:, i], 1)[0]) * 600 if len(late) > 2 else float("nan")
        found[name] = {
            "every minute": table[:: round(60 / EVERY), i].round(1).tolist(),
            "first": round(table[0, i], 1),
            "last": round(table[-1, i], 1),
            "per 10 minutes": round(slope, 2),
        }
    return found


def main() -> None:
    """Run, look, and tell."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=1.5)
    parser.add_argument("--rate", default="1000")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "live_page")
    arguments = parser.parse_args()
    from playwright.sync_api import sync_playwright

    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    out = arguments.out
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    seconds = 60 * arguments.minutes
    shutil.copy(ROOT / "data" / "bench.toml", out)  # a page that is kept shows no folders of this machine
    call = [sys.executable, "-m", "optid.cli", "live", "bench.toml", "--page", "--out", "session"]
    call += ["--rate", arguments.rate, "--seconds", f"{seconds:g}", "--gains", "kp=25 ki=20"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    where = {**os.environ, "PYTHONPATH": str(ROOT)}
    with (
        subprocess.Popen(call, cwd=out, env=where, **pipes) as session,
        sync_playwright() as started,
    ):
        assert session.stdout is not None
        line = session.stdout.readline()
        begun = time.monotonic()
        browser = started.chromium.launch(
            executable_path=path,
            args=["--no-sandbox", "--enable-precise-memory-info", "--js-flags=--expose-gc"],
        )
        page = browser.new_page(viewport=SIZE)
        complaints: list[str] = []
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.set_default_timeout(180e3)  # the machine may be busy
        page.goto(line.split()[-1])
        seen = tour(page, out)
        driver = next(
            pid for pid in descendants(os.getpid()) if b"chrom" in Path(f"/proc/{pid}/cmdline").read_bytes()
        )
        grown = watch(page, session, driver, begun + seconds - 15.0)
        words = session.communicate(timeout=120)[0]
        browser.close()
    document = json.loads((out / "session" / "live.json").read_text(encoding="utf-8"))
    missed = document["missed"] / max(document["samples"] + document["missed"], 1)
    result = {
        "seen": seen,
        "complaints": complaints,
        "memory, MB": grown,
        "samples": document["samples"],
        "missed, %": round(100 * missed, 4),
        "timing": document["timing"],
        "outcome": document["outcome"],
    }
    (out / "live_page.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print(words[-1500:])
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
