"""The page in a headless Chromium: it loads, drags, and drives."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.page import page
from rimless_gym import BUILDABLE

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here"),
]

#: Collects errors from the beginning; `report` writes what was found into the document.
BEFORE = """<script>
const problems = [];
addEventListener('error', (event) => problems.push(event.message));
addEventListener('unhandledrejection', (event) => problems.push(String(event.reason)));
const complain = console.error;
console.error = (...all) => { problems.push(all.join(' ')); complain(...all); };
function report(found) {
  const place = document.createElement('pre');
  place.id = 'found';
  place.textContent = JSON.stringify({ problems, ...found });
  document.body.append(place);
}
</script>"""


def in_chromium(text: str, tmp_path: Path, program: str, size: str = "1280,800") -> dict[str, Any]:
    """What a program in a page reports; it runs after the first frames.

    Args:
        text: the page.
        tmp_path: a folder for the browser.
        program: JavaScript that calls `report` with an object.
        size: width and height of the window.
    """
    run = f"<script>setTimeout(() => {{ {program} }}, 500);</script></body>"
    watched = text.replace("<head>", f"<head>{BEFORE}", 1)
    file = tmp_path / "page.html"
    file.write_text(run.join(watched.rsplit("</body>", 1)), encoding="utf-8")
    assert CHROMIUM is not None
    done = subprocess.run(
        [
            *(CHROMIUM, "--no-sandbox", "--headless=new", "--disable-gpu", "--dump-dom"),
            *(f"--window-size={size}", "--virtual-time-budget=1500"),
            *(f"--user-data-dir={tmp_path / 'profile'}", file.as_uri()),
        ],
        capture_output=True,
        text=True,
        timeout=600,
        check=True,
    )
    found = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, flags=re.DOTALL)
    assert found is not None, done.stderr[-2000:]
    values: dict[str, Any] = json.loads(html.unescape(found[1]))
    assert values["problems"] == []
    return values


whole_page = cache(page)


@pytest.mark.parametrize("size", ["390,844", "1280,800"])
def test_dragging_along_the_front_chooses_another_gait(tmp_path: Path, size: str) -> None:
    found = in_chromium(
        whole_page(),
        tmp_path,
        """
        const chart = document.getElementById('chart');
        const box = chart.getBoundingClientRect();
        const speeds = [front.gait.speed];
        const move = (type, share) => {
          const at = { clientX: box.left + share * box.width, clientY: box.top + 50 };
          chart.setPointerCapture = () => {};
          chart.dispatchEvent(new PointerEvent(type, { ...at, buttons: 1, pointerId: 1 }));
          speeds.push(front.gait.speed);
        };
        move('pointerdown', 0.3);
        move('pointermove', 0.6);
        move('pointermove', 0.9);
        const text = document.getElementById('gait-title').textContent;
        const wide = document.documentElement.scrollWidth - innerWidth;
        report({ speeds, text, wide });
        """,
        size,
    )
    assert len(set(found["speeds"])) == 4
    assert "the pendulum swings" in found["text"]
    assert found["wide"] <= 0  # nothing reaches beyond the page's side


def test_the_wheel_can_be_driven_by_keys_and_by_the_lever(tmp_path: Path) -> None:
    found = in_chromium(
        whole_page(),
        tmp_path,
        """
        document.getElementById('rest').click();
        document.getElementById('start').click();
        const press = (type, key) => dispatchEvent(new KeyboardEvent(type, { key, bubbles: true }));
        drive.held.keys.add('ArrowRight');
        const right = heldVoltage() - coasting(drive.you.state, drive.you.p);
        press('keyup', 'ArrowRight');
        const free = heldVoltage();
        const lever = document.getElementById('lever');
        lever.setPointerCapture = () => {};
        const box = lever.getBoundingClientRect();
        const hold = (type, share) => lever.dispatchEvent(
          new PointerEvent(type, { clientX: box.left + share * box.width, pointerId: 2 }));
        hold('pointerdown', 0.25);
        const pulled = heldVoltage();
        for (let k = 0; k < 320; k++) {
          hold('pointermove', Math.sin(0.72 * k) > 0 ? 0.71 : 0.29);
          followDrive(0.1);
        }
        hold('pointerup', 0.5);
        const { distance, energy, time } = drive.you.overall;
        report({ right, free, pulled, distance, energy, time, phase: drive.phase,
          policy: drive.policy.overall, score: scoreText() });
        """,
    )
    assert (found["right"], found["free"]) == (3, None)
    assert found["pulled"] == pytest.approx(-6.0, abs=0.2)
    assert found["phase"] == "done"
    assert found["time"] == pytest.approx(30.0, abs=0.02)
    assert found["energy"] > 10.0
    assert "30 s" in found["score"]
    assert found["policy"]["distance"] > 15.0  # it walks from rest, in the page


def test_the_first_level_rewards_the_first_metre_and_whoever_follows_the_hints(
    tmp_path: Path,
) -> None:
    found = in_chromium(
        whole_page(),
        tmp_path,
        """
        const race = (hands) => {
          start();
          while (drive.phase === 'racing') {
            drive.held.keys = new Set(hands());
            followDrive(0.02);
            drawDrive();
          }
          drive.held.keys.clear();
          const message = document.getElementById('message').textContent;
          return { distance: drive.you.distance, message };
        };
        const follow = () => {
          const hint = document.querySelector('.lever .text').textContent;
          if (hint.startsWith('let go')) return [];
          return [hint.startsWith('now') ? 'ArrowRight' : 'ArrowLeft'];
        };
        report({ idle: race(() => []), follow: race(follow) });
        """,
    )
    assert found["idle"]["distance"] > 1.0  # it walks on for some steps
    assert "of the policy's way" in found["idle"]["message"]
    assert found["follow"]["distance"] > 3.0


def test_sliders_change_the_machine(tmp_path: Path) -> None:
    found = in_chromium(
        whole_page(),
        tmp_path,
        """
        const set = (id, value) => {
          const input = document.getElementById(id);
          input.value = value;
          input.dispatchEvent(new Event('input'));
        };
        set('slope', 2);
        set('gear', 25);
        set('losses', 1);
        for (let k = 0; k < 100; k++) followDrive(0.1);
        const { slope, gear_ratio, hub_friction, gear_loss } = drive.policy.machine;
        const gravity = drive.policy.p.gx;
        document.getElementById('reset').click();
        report({ slope, gear_ratio, hub_friction, gear_loss, gravity, same: !altered() });
        """,
    )
    machine = BUILDABLE.replace(
        slope=np.radians(2), gear_ratio=25.0, hub_friction=0.0424, gear_loss=0.14
    )
    for name in ("slope", "gear_ratio", "hub_friction", "gear_loss"):
        assert found[name] == pytest.approx(getattr(machine, name))
    assert found["gravity"] == pytest.approx(machine.constants.gx)
    assert found["same"]
