"""User-visible texts that several modules use or tests check; others are where they are used."""

from dataclasses import dataclass

TITLE = "Co-speech motion workbench"
TAGLINE = (
    "Generates gestures and body motion (SMPL-X) from one speech recording with several systems, "
    "in the same gesture style and from the same noise seed. Watch the results side by side and "
    "see where the jitter comes from."
)
DEMO_WEIGHTS = (
    "<b>Demonstration weights</b>, trained by this project on {data}. The results here are not "
    "those reported in the papers."
)
UNTRAINED = (
    "These weights are <b>random (untrained)</b>. The motion is meaningless; the page only shows "
    "that the software works."
)

PAPER = (
    "This page is about <b>GlobalDiff</b>: X. Zhang, J. Li, J. Ren and J. Zhang, <i>Mitigating "
    "Error Accumulation in Co-Speech Motion Generation via Global Rotation Diffusion and "
    "Multi-Level Constraints</i>, AAAI 2026. This app is an independent project."
)
PAPER_LINKS = {
    "Paper": "https://arxiv.org/abs/2511.10076",
    "Project page": "https://xiangyuezhang.com/GlobalDiff/",
    "The authors' code": "https://github.com/Xiangyue-Zhang/GlobalDiff",
}
WEIGHTS = "Weights: {are}."

MOTION_TAB = "Motion"
LADDER_TAB = "Systems"
STUDY_TAB = "User study"


SPEECH_HELP = "Upload or record speech of {min_s:g} seconds to {max_min:g} minutes."
OWN_GROUP, ABLATION_GROUP, OTHERS_GROUP = "Our systems", "GlobalDiff's ablation", "Other systems"
SEED_LABEL = "Seed"
SAMPLES_LABEL = "Samples per system"
GUIDANCE_LABEL = "Speech guidance scale"
GUIDANCE_HELP = (
    "How strongly the speech influences the gestures (classifier-free guidance). The papers' code "
    "uses 1. At 1, the speech has little effect: with the same seed, different speech gives nearly "
    "the same gestures."
)
GUIDANCE_NAMES = {1.0: "1, as trained"}
ADVANCED_LABEL = "Advanced"
FILTER_LABEL = "Filter the motion of all systems (Savitzky-Golay, 7 frames, order 2)"
FILTER_HELP = (
    "Off: the raw output of the models. On: filtered before rendering, as in the official code. "
    "Metrics are always computed for both."
)
REFERENCE_LABEL = "Reference motion (.npz, .npy or .bvh, optional)"
POINT_LABEL = "Tracked point (plots and metrics)"
TRANSCRIPT_LABEL = "Transcript (.TextGrid, .srt, .vtt or English text as .txt; optional)"
WORDS_LABEL = "Recognise words"
WORDS_HELP = (
    "Recognises English words in the speech if no transcript is given. Systems with gesture plans "
    "(workbench/planned) choose and time gestures by the words. In runs with such a system, the "
    "words are recognised before the motion is generated; in other runs, afterwards."
)
GENERATE = "Generate motion"
CANCEL = "Cancel"

ENLARGE_FIGURE = "Enlarge: {title}"


@dataclass(frozen=True)
class FigureText:
    """Title, help text and findings of a figure."""

    title: str
    help: str
    sentence_keys: tuple[str, ...]
    """Keys of `app.findings.sentences.figure_sentences`, in the order of the plots."""


FIGURES = {
    "figure6": FigureText(
        "Fingertip trajectory and poses",
        "Fingertip position over up to 300 frames (10 s), with a pose every 50 frames. A jagged "
        "line shows jitter that is easy to miss in the video. With more than two systems, each has "
        "its own row.",
        ("trajectory",),
    ),
    "jitter": FigureText(
        "Where the jitter comes from",
        "Jerk by depth in the skeleton, by frequency, by the joint that causes it, and by "
        "frame within the generation window.",
        ("depth", "spectrum", "attribution", "seams"),
    ),
    "error_growth": FigureText(
        "Growth of rotation errors along the chain",
        "Shift of each point along the arm after the same small noise is added to local or to "
        "global rotations. Marks are measured; lines are the analytical prediction.",
        (),
    ),
    "distributions": FigureText(
        "Distribution of each metric over clips",
        "Cumulative distribution: the share of clips at or below each value. A curve further to "
        "the right means larger values.",
        (),
    ),
    "speech_effect": FigureText(
        "Effect of the speech and of the noise seed",
        "Lines of the same colour have the same speech; lines of the same style (solid or dashed) "
        "have the same noise seed. If the motion follows the speech, lines of the same colour rise "
        "and fall together.",
        (),
    ),
    "steps": FigureText(
        "Quality and time by sampling steps",
        "Each mark is the result for one number of sampling steps. Where a curve is flat, more "
        "steps do not help.",
        (),
    ),
}
FIGURES["hearing"] = FIGURES["speech_effect"]  # its former name
CAPTION = "Caption (for your paper)"
REDRAW = "Change panels, frames or width"
OVER_CLIPS = ", mean over clips with 95 % confidence interval"
NUMBERS_HEADING = "Metrics"
NUMBERS_HELP = (
    "Tracked point: {point}. Lower jerk means smoother, not better: natural gestures "
    "have jerk, too. Read beat alignment together with its chance level."
)
AS_GENERATED = "As generated"
FILTERED = "Filtered"
FILTER_SWITCH = "Filter for plots and metrics (all systems)"
NEAREST_LEGEND = "closest to the reference"
NO_REFERENCE_LEGEND = "Add a reference motion to see which system is closest to it."
ALL_MEASURES = "Show all {count} metrics"
CSV_LABEL = "Save as CSV"
GO_THERE = "Show {where}"

VIEW_NAMES = {
    "front": "Front view",
    "three_quarter": "Three-quarter view",
    "side": "Side view",
    "face": "Face close-up",
    "left_hand": "Left hand close-up",
    "right_hand": "Right hand close-up",
}
SAVE_RUN = "Save the run"
SAVE_RUN_HELP = "The complete run as a zip file. Drop it on this page to reopen the run."
SAVE_PAGE = "Save as a web page"
SAVE_PAGE_HELP = (
    "One HTML file with the bodies, the audio and the timeline. It plays in any browser without "
    "this software."
)
RUN_LINK_HELP = "Anyone with the link can open the run. The link expires in {minutes} minutes."
COMPARE = "Compare the two selected runs"
COMPARE_THIS = "Compare {title}"
COMPARE_HELP = "Select two runs to compare them."
COMPARE_LAST = "Compare with your previous run"
COMPARE_OTHER = "Compare with your previous run (different speech)"
PAIR_LINK = "Link to this comparison"
PAIR_SAME_SETTINGS = "All settings are the same."
PAIR_BROUGHT = "Run {run} was imported from your files, not generated here."
PAIR_ONE_SPEECH = "Both runs use the same speech ({speech}) and play in sync."
PAIR_ONLY_SEED = (
    "Same speech and settings; only the seed differs. The differences show how much the metrics "
    "vary by chance alone."
)
PAIR_OTHER_SPEECH = (
    "The runs use different speech ({first} and {second}). Choose which audio plays. Note that the "
    "speech itself also changes the metrics."
)
PAIR_LEGEND = "A is the earlier run. Differences are B minus A."
PAIR_DIFFERENCE = "B \N{MINUS SIGN} A"
RUN_GONE = "This run has expired. Runs and their files are deleted after {minutes} minutes."

STAGE_NAMES = {
    "speech": "Read the inputs",
    "motion": "Generate motion",
    "numbers": "Compute the metrics",
    "video": "Render videos",
    "comparison": "Compose the comparison video",
    "figure": "Draw the figures",
}
READY = "Ready."
LOADING = "Loading the run."
STARTING = "Starting."
STARTING_SYSTEMS = "Loading the systems."
DONE = "Done in {seconds:.0f} s: {rows} of up to {frames} frames (30 fps)."
VIEWER_VIDEO_STARTING = "The video of the 3D viewer will be rendered as soon as a renderer is free."
VIEWER_VIDEO_PROGRESS = "Rendering the video of the 3D viewer: {percent:.0f} %."
VIEWER_VIDEO_DONE = (
    "The video of the 3D viewer is ready: {bodies}, {seconds:.1f} s, {megabytes:.1f} MB."
)
VIEWER_VIDEO_DAMAGED = "The viewer sent invalid data: {why} Please reload the page."
PLAN_LABEL = "Gesture plan (.json, .TextGrid or .eaf)"
EDITS_DAMAGED = "The gesture editor sent an invalid request. Please reload the page."
EDITS_GONE = (
    "This run has expired or belongs to another browser. Generate the motion again to edit it."
)
TOO_MANY_TAKES = (
    "This run already has {limit} edited versions. Generate the motion again to make more."
)
TAKE_BEGINS = "Regenerating the motion."
TAKE_COMING = "Regenerating version {number}. The finished part can already be played."
TAKE_JERK = "Jerk of the tracked point: {} m/s³."
TAKE_DONE = "Version {number} is ready."
EDITOR_BEGINS = "The editor is loading the gestures and the systems. This happens only once."
EDITOR_READY = "Select a gesture on the timeline, or add one."
VIEWER_VIDEO_GONE = (
    "A motion in the viewer has expired. Start the run again, then record the video."
)
VIDEOS_LABEL = "Also render videos"
VIDEOS_HELP = (
    "Video files to download or share. They are rendered in the background; the 3D viewer does not "
    "need them."
)
VIDEOS_DONE = "The videos are ready."
VIDEOS_MISSING = (
    "{missing} of {count} videos are not rendered yet. A run saved now does not contain them."
)
STOPPED = "Stopped. Nothing was saved."
CANCELLED = "Cancelled. Nothing was saved."
FAILED_TITLE = "The run failed"
NOTES_TITLE = "Notes"
MORE_NOTES = "All {count} notes are in run.json of the saved run."

CLIPS_LABEL = "Several clips"
CLIPS_HELP = (
    "Up to {count} files of at most {size} each, {max_min:g} minutes in total. They form one run, "
    "with one table row per clip and a summary with confidence intervals over clips. No videos are "
    "rendered. The speech above, if any, is included."
)
CLIP_OTHER = "{name} is not a supported audio file. Supported: {known}."
OF_ONE_CLIP = (
    "A reference motion, a transcript or a plan belongs to a single clip. Remove it, or run that "
    "clip on its own."
)
CLIP = "Clip"
CLIPS_DONE = "{done} of {count} clips are done. Below the table, choose the clip to show."
CLIPS_MEAN = "Mean [95 % confidence interval over clips]"
NO_SPEECH = "There is no speech yet. Upload or record some, or choose an example."
TOO_MANY_VIDEOS = (
    "{systems} with {samples} each give {count} bodies, including the reference if there is one. "
    "This page shows at most {limit}; choose fewer."
)
DISK_FULL = "The server is out of disk space at the moment. Please try again later."
INTERNAL_ERROR = (
    "Something went wrong inside the program, not with your input. Please report it with this "
    "number: {fault_id}."
)
