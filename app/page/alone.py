"""A run in one file: bodies, sound and time line, for any browser and without a server.

What the player's modules would ask a server for lies in the file and is handed to them by a
``fetch`` of its own; the modules themselves are an import map of what app/page/web holds.
"""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fastapi.routing import APIRoute

from app.errors import RunError
from app.findings.verdict import short_names
from app.live.live_body import body_glb, builds
from app.page.player.player import gravest_of, noise_of
from app.page.player.timeline import series_looks
from app.page.results.kept_runs import RUN_ROUTE
from app.page.results.run_file import PAGE_ENDING, saving_route
from app.page.routes.stage_route import stage_facts
from app.page.theme import PLAYER_CSS, make_theme, theme_variables
from app.run.pieces import MAX_FRAMES, frames_message
from app.run.videos.own_videos import register_of
from conventions.names import REFERENCE_NAME
from model.storage.files import written_atomically

if TYPE_CHECKING:
    from pathlib import Path

    from app.page.results.kept_runs import EndedRun, KeptRuns
    from model.faults.evidence import Finding
    from model.motion.motion import Motion
    from model.plan.plan import GesturePlan

WEB = Path(__file__).resolve().parent / "web"
DOOR = "player/player.js"
"""The module that the file starts."""
BODY, FACTS, BUILDS = "live/body.glb", "stage/facts.json", "stage/builds.bin"
"""Where the page has what every player asks for."""
TIMELINE = "timeline.json"
_IMPORTED = re.compile(r'(?<=from ")(\.{1,2}/[^"]+)(?=")')
"""The modules have no imports of another form; a test holds that."""
_STYLE = """
body { margin: 0; padding: 8px 10px; font-family: system-ui, sans-serif; background: var(--body-background-fill); }
.lockstep .more-box > button, .lockstep .fold { display: none; } /* these ask a server */
"""  # noqa: E501
_SCRIPT = """
const kept = JSON.parse(document.getElementById("kept").textContent);
const ask = window.fetch.bind(window);
async function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}
window.fetch = async (url, options) => (Object.hasOwn(kept.files, url) ? new Response(await unpacked(kept.files[url])) : ask(url, options));
const dark = matchMedia("(prefers-color-scheme: dark)");
const follow = () => document.body.classList.toggle("dark", dark.matches);
dark.addEventListener("change", follow);
follow();
"""  # noqa: E501
_START = f"""
import {{ mountPlayer }} from "web/{DOOR}";
if (kept.sound) kept.value.audio = URL.createObjectURL(new Blob([await unpacked(kept.sound)], {{ type: "audio/wav" }}));
mountPlayer(document.body, {{ value: kept.value }}, () => {{}});
"""  # noqa: E501


@dataclass(frozen=True, eq=False)
class Scene:
    """What is seen and heard in one file."""

    motions: Mapping[str, Motion]
    """By name; the recorded one, if there is one, as `REFERENCE_NAME`. At most 2184 s each."""
    timeline: Mapping[str, Any]
    """As `app.page.player.timeline.make_timeline` and `tiers_of` give it."""
    sound: bytes | None = None
    """A wav file."""
    plans: Mapping[str, GesturePlan] = field(default_factory=dict)
    """By the name of the motion that performs it."""
    findings: Mapping[str, list[Finding]] = field(default_factory=dict)
    title: str = "Co-speech motion"


def player_alone(scene: Scene) -> str:
    """HTML that needs nothing beside itself.

    Raises:
        RunError: of no motion, or of a longer one than a browser plays.
    """
    _check(scene)
    files = _files(scene)
    content = {
        "files": {name: _packed(data) for name, data in files.items()},
        "sound": _packed(scene.sound) if scene.sound is not None else None,
        "value": _value(scene, files),
    }
    modules = {f"web/{path}": _module(path) for path in _needed(DOOR)}
    style = theme_variables(make_theme()) + "".join(path.read_text() for path in PLAYER_CSS)
    return "\n".join(
        [
            "<!doctype html>",
            f'<html lang="en"><head><meta charset="utf-8"><title>{escape(scene.title)}</title>',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<style>{style}{_STYLE}</style></head>",
            '<body><div class="lockstep" hidden></div>',
            f'<script type="application/json" id="kept">{_in_html(content)}</script>',
            f"<script>{_SCRIPT}</script>",
            f'<script type="importmap">{_in_html({"imports": modules})}</script>',
            f'<script type="module">{_START}</script>',
            "</body></html>\n",
        ]
    )


def _check(scene: Scene) -> None:
    if not scene.motions:
        raise RunError("There is no motion to be shown; give at least one.")
    longest = max(scene.motions, key=lambda name: scene.motions[name].num_frames)
    count = scene.motions[longest].num_frames
    if count > MAX_FRAMES:
        raise RunError(
            f"{longest} has {count} frames; a browser plays at most {MAX_FRAMES}. Show a part."
        )


def _files(scene: Scene) -> dict[str, bytes]:
    """By address."""
    plans = {
        _plan_address(name): json.dumps({"origin": "planned", **json.loads(plan.as_json())})
        for name, plan in scene.plans.items()
    }
    return {
        BODY: body_glb(),
        FACTS: stage_facts(),
        BUILDS: builds(),
        TIMELINE: json.dumps(scene.timeline, separators=(",", ":")).encode(),
        **{address: plan.encode() for address, plan in plans.items()},
        **{
            _frames_address(name): frames_message(0, motion)
            for name, motion in scene.motions.items()
        },
    }


def _value(scene: Scene, files: Mapping[str, bytes]) -> dict[str, Any]:
    """As `app.page.player.player.Showing.value` tells a finished run."""
    looks, labels = series_looks(tuple(scene.motions)), short_names(scene.motions)
    rows = []
    for name, motion in scene.motions.items():
        place = register_of(motion)
        count = motion.num_frames
        there = {"end": count, "num_frames": count, "bytes": len(files[_frames_address(name)])}
        rows.append(
            {
                "name": name,
                "label": labels[name],
                "color": looks[name].color,
                "dashes": list(looks[name].dashes),
                "stem": name,
                "is_reference": name == REFERENCE_NAME,
                "noise": noise_of(name),
                "frames": _frames_address(name),
                "there": {**there, "place": [place.turn_rad, *place.shift_m]},
                **({"plan": _plan_address(name)} if name in scene.plans else {}),
            }
        )
    findings = gravest_of(scene.findings)
    return {"run": "alone", "rows": rows, "timeline": TIMELINE, "findings": findings}


def _frames_address(name: str) -> str:
    return f"frames/{name}"


def _plan_address(name: str) -> str:
    return f"plan/{name}"


def _needed(module: str) -> list[str]:
    """The module and all that it needs, by their places in app/page/web."""
    found = [module]
    for each in found:
        folder = (WEB / each).parent
        for imported in _IMPORTED.findall((WEB / each).read_text()):
            path = (folder / imported).resolve().relative_to(WEB).as_posix()
            if path not in found:
                found.append(path)
    return found


def _module(path: str) -> str:
    """A module as an address, with what it imports by names of the import map."""
    folder = (WEB / path).parent

    def named(found: re.Match[str]) -> str:
        return "web/" + (folder / found.group()).resolve().relative_to(WEB).as_posix()

    source = _IMPORTED.sub(named, (WEB / path).read_text())
    return "data:text/javascript;base64," + base64.b64encode(source.encode()).decode("ascii")


def _packed(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, 6, mtime=0)).decode("ascii")


def _in_html(content: object) -> str:
    """JSON that no HTML can be found in."""
    return json.dumps(content, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def save_page(run: EndedRun, out: Path) -> Path:
    """Write what a run that has ended shows, whole or not at all: its bodies, its sound, time line
    and plans. Takes of edited plans are not among them.

    Raises:
        RunError: of motion that no browser plays.
    """
    from model.motion.motion import load_motion
    from model.plan.plan import read_plan

    assert run.showing is not None
    sound = run.showing.sound()
    scene = Scene(
        motions={
            name: load_motion(path).part(slice(MAX_FRAMES))
            for name, path in run.showing.drawn().items()
        },
        timeline=run.showing.timeline(),
        sound=None if sound is None else sound.read_bytes(),
        plans={
            name: read_plan(path) for name, path in run.showing.performed.items() if path.is_file()
        },
        findings=run.diagnostics.findings,
        title=run.title,
    )
    with written_atomically(out) as part:
        part.write_text(player_alone(scene), encoding="utf-8")
    return out


def run_page_routes(kept: KeptRuns) -> list[APIRoute]:
    """Serve runs as such pages."""
    path, media_type = RUN_ROUTE + "/{token}/page", "application/octet-stream"
    return [saving_route(kept, path, PAGE_ENDING, media_type, save_page)]
