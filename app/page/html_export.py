"""Export of a run, or of those of several clips, to one HTML file that any browser plays offline.

The file holds everything that the player would fetch from a server, and overrides ``fetch`` to read
it; the modules of app/page/web are an import map.
"""

from __future__ import annotations

import base64
import gzip
import json
import re
from html import escape
from pathlib import Path
from typing import Any

from app import text
from app.errors import RunError
from app.page.parts import markup
from app.page.results.run_view import RunView
from app.page.results.tables import jerk_bars, jerk_by_clip_html, runs_title
from app.page.routes.media import VIEWER_ASSETS
from app.page.theme import PLAYER_CSS, make_theme
from app.run.frame_packets import MAX_FRAMES
from app.run.output.provenance import PROVENANCE, WEIGHTS_ARE_KEY
from app.run.output.run_folder import DAMAGED, MAX_RUN_BYTES, RowFileKind, existing_file, find_runs
from model.storage.json_validation import InvalidJsonError, read_json

WEB = Path(__file__).resolve().parent / "web"
ENTRY_MODULE = "player/player.js"
"""Module that the file starts."""
_PLAYED: tuple[RowFileKind, ...] = ("frames", "plan", "input_plan")
NOTHING_TO_PLAY = (
    "The HTML file would show nothing: it can contain motions of at most {frames} frames, and all "
    "motions of this run are longer. Generate or measure a shorter part."
)
_IMPORTED = re.compile(r'(?<=from ")(\.{1,2}/[^"]+)(?=")')
"""Pattern of relative imports in the modules; a test checks that there are no others."""
_STYLE = """
body { margin: 0; padding: 8px 10px; font-family: Inter, system-ui, sans-serif; color: var(--body-text-color); background: var(--body-background-fill); }
header { margin-bottom: 8px; font-size: 14px; line-height: 1.45; }
h1, header p { margin: 0; }
h1 { font-size: 17px; }
header .scroll { overflow-x: auto; }
.dark { color-scheme: dark; }
header table { margin: 6px 0; border-spacing: 12px 1px; text-align: right; white-space: nowrap; }
header th:first-child { text-align: left; white-space: normal; }
.lockstep .more-box > button, .lockstep .fold { display: none; } /* these ask a server */
"""  # noqa: E501
_SCRIPT = """
const bundle = JSON.parse(document.getElementById("bundle").textContent);
const ask = window.fetch.bind(window);
async function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}
window.fetch = async (url, options) => (Object.hasOwn(bundle.files, url) ? new Response(await unpacked(bundle.files[url])) : ask(url, options));
const dark = matchMedia("(prefers-color-scheme: dark)");
const follow = () => document.body.classList.toggle("dark", dark.matches);
dark.addEventListener("change", follow);
follow();
"""  # noqa: E501
_START = f"""
import {{ mountPlayer }} from "web/{ENTRY_MODULE}";
const props = {{ value: {{}} }};
let update = () => {{}};
async function choose(run) {{
  const {{ audio, ...value }} = bundle.runs[run];
  props.value = value;
  if (audio) value.audio = URL.createObjectURL(new Blob([await unpacked(bundle.files[audio])], {{ type: "audio/wav" }}));
  update();
}}
await choose(0);
mountPlayer(document.body, props, (name, callback) => {{ update = callback; }});
document.querySelector("header select")?.addEventListener("change", ({{ target }}) => choose(target.selectedIndex));
"""  # noqa: E501


def standalone_html(folder: Path) -> str:
    """Make the HTML of a folder of one or several runs; raises RunError if none can be played."""
    files: dict[str, bytes] = {}

    def to_url(path: Path) -> str:
        name = path.relative_to(folder).as_posix()
        files[name] = path.read_bytes()
        return name

    runs = find_runs(folder) or {"": folder}
    run_views = {clip: RunView(run, to_url, name=f"alone{clip}") for clip, run in runs.items()}
    records = {clip: run_view.record for clip, run_view in run_views.items()}
    over_clips = jerk_by_clip_html(records)
    for record in records.values():
        for row in record.rows:
            row.files = {kind: row.files[kind] for kind in _PLAYED if kind in row.files}
        record.rows = [row for row in record.rows if "frames" in row.files]
    played = {clip: run_view for clip, run_view in run_views.items() if records[clip].rows}
    if not played:
        raise RunError(NOTHING_TO_PLAY.format(frames=MAX_FRAMES))
    values = [
        {**each.player_value(), "running": False, "plays_when_ready": False}
        for each in played.values()
    ]
    first = records[next(iter(played))]
    title = runs_title(list(records.values()))
    head = f"<h1>{escape(title)}</h1>" if title else ""
    if over_clips:
        options = "".join(f"<option>{escape(clip)}</option>" for clip in played)
        head += f"{over_clips}<label>{text.CLIP} <select>{options}</select></label>"
    elif first.verdict is not None:
        verdict, bars = first.verdict, jerk_bars(first)
        head += markup.verdict(verdict.jerk_sentence, verdict.comparison, bars)
        head += (
            f"<p>{escape(markup.split_first_sentence(verdict.comparison)[1])}</p>" if bars else ""
        )
    if path := existing_file(next(iter(runs.values())), PROVENANCE):
        are = str(_object_in(path).get(WEIGHTS_ARE_KEY, ""))
        head += f"<p>{text.WEIGHTS.format(are=escape(are))}</p>" if are else ""
    files |= {name: make() for name, (make, _) in VIEWER_ASSETS.items()}
    content = {"files": {name: _packed(data) for name, data in files.items()}, "runs": values}
    modules = {f"web/{path}": _module(path) for path in _needed(ENTRY_MODULE)}
    style = make_theme()._get_theme_css() + "".join(path.read_text() for path in PLAYER_CSS)
    return "\n".join(
        [
            "<!doctype html>",
            f'<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f'<style>{style}{_STYLE}</style></head><body class="columns folded">',
            f'<header>{head}</header><div class="lockstep" hidden></div>',
            f'<script type="application/json" id="bundle">{_in_html(content)}</script>',
            f"<script>{_SCRIPT}</script>",
            f'<script type="importmap">{_in_html({"imports": modules})}</script>',
            f'<script type="module">{_START}</script>',
            "</body></html>\n",
        ]
    )


def _object_in(path: Path) -> dict[str, Any]:
    """Read a JSON object from a file; raises RunError if it holds none."""
    try:
        return read_json(path, dict[str, Any], MAX_RUN_BYTES)
    except InvalidJsonError as error:
        raise RunError(DAMAGED.format(name=path.name, why=error)) from None


def _needed(module: str) -> list[str]:
    """Return a module and all modules that it imports, as paths in app/page/web."""
    modules = [module]
    for each in modules:
        folder = (WEB / each).parent
        for imported in _IMPORTED.findall((WEB / each).read_text()):
            path = (folder / imported).resolve().relative_to(WEB).as_posix()
            if path not in modules:
                modules.append(path)
    return modules


def _module(path: str) -> str:
    """Return a module as a data URL, with imports renamed as in the import map."""
    folder = (WEB / path).parent

    def named(match: re.Match[str]) -> str:
        return "web/" + (folder / match.group()).resolve().relative_to(WEB).as_posix()

    source = _IMPORTED.sub(named, (WEB / path).read_text())
    return "data:text/javascript;base64," + base64.b64encode(source.encode()).decode("ascii")


def _packed(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, 6, mtime=0)).decode("ascii")


def _in_html(content: object) -> str:
    """Format JSON such that it contains no HTML."""
    return json.dumps(content, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def write_standalone_html(request: tuple[Path, Path], *_: object) -> None:
    """Write the player of a run's folder into an HTML file, as a task."""
    folder, out = request
    out.write_text(standalone_html(folder), encoding="utf-8")
