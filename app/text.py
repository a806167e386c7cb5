"""User-visible texts that several modules use or tests check; others are where they are used."""

from dataclasses import dataclass

TITLE = "Co-speech motion workbench"
TAGLINE = (
    "Speech in, SMPL-X motion out, from several models at once: same speech, same speaker, "
    "same noise. Watch them side by side and see where the jitter sits."
)
DEMO_WEIGHTS = (
    "<b>Demonstration weights</b>, trained here on {data}: no number here is the paper's."
)
UNTRAINED = (
    "These weights are <b>random: nothing has been trained</b>. The motion means nothing; the page "
    "only shows that everything works."
)

WEIGHTS = "Weights: {are}."

MOTION_TAB = "Motion"
LADDER_TAB = "Systems"
STUDY_TAB = "User study"


SPEECH_HELP = "Upload or record {min_s:g} seconds to {max_min:g} minutes."
OWN_GROUP, LADDER_GROUP, OTHERS_GROUP = "Our own", "The paper's ladder", "Others"
SEED_LABEL = "Seed"
SAMPLES_LABEL = "Samples per system"
GUIDANCE_LABEL = "Strength of the speech"
GUIDANCE_HELP = (
    "How much what is said changes the gestures. The papers' own code draws with 1, where other "
    "speech with the same seed gives nearly the same gestures."
)
GUIDANCE_NAMES = {1.0: "1, as trained"}
ADVANCED_LABEL = "Advanced"
FILTER_LABEL = "Smooth every system (Savitzky-Golay 7/2)"
FILTER_HELP = (
    "Off shows what the models made. On is what the official code does before anyone looks. "
    "The numbers always give both."
)
REFERENCE_LABEL = "Reference motion (.npz, .npy or .bvh, optional)"
POINT_LABEL = "Point to follow in plots and measures"
TRANSCRIPT_LABEL = "Words: .TextGrid, subtitles, or English as .txt (optional)"
WORDS_LABEL = "Recognise words"
WORDS_HELP = "Of English, where no text is given; beside the drawing."
GENERATE = "Generate motion"
CANCEL = "Cancel"

LOOK_QUESTION = "Which hand trembles?"
LOOK_ABOUT = (
    "Two bodies, one motion: what {system} made of an example's speech. On one arm of one of them "
    "lies a tremble that its joints hardly show, and a fingertip does. Watch the hands."
)
LOOK_SHOW = "Show the answer"
LOOK_ANSWER = (
    "The right hand of {row}, on the left of the picture. Shoulder, elbow and wrist turn by "
    "{noise:g} rad at random in each frame; its fingertip jerks {trembling:,} m/s³, that of the "
    "other {steady:,}. The time line shows it, and Worst second leads to it."
)
ENLARGE_FIGURE = "Show large: {title}"


@dataclass(frozen=True)
class FigureText:
    """Title, help text and findings of a figure."""

    title: str
    help: str
    says: tuple[str, ...]
    """Keys of `app.findings.sentences.sentences_of`, in the order of the plots."""


FIGURES = {
    "figure6": FigureText(
        "Fingertip trajectory and poses",
        "The fingertip over up to 300 frames (10 s), and poses every 50 frames. A jagged line is "
        "jitter that the eye may miss in the video; of more than two systems each has its own row.",
        ("trajectory",),
    ),
    "jitter": FigureText(
        "Where the jitter sits",
        "By depth along the skeleton, by frequency, by the joint that causes it, and by the place "
        "in a generated window.",
        ("depth", "spectrum", "attribution", "seams"),
    ),
    "error_growth": FigureText(
        "How rotation errors grow along the chain",
        "The same small noise on local and on global rotations: marks are measured, lines are the "
        "closed form.",
        (),
    ),
    "distributions": FigureText(
        "How measures are spread over clips",
        "Share of a set's clips at or below a value: a curve further to the right has more of it.",
        (),
    ),
    "hearing": FigureText(
        "What speech decides, and what chance",
        "Lines of one colour share the speech, lines of one kind the noise. Where a system hears, "
        "lines of one colour rise and fall together.",
        (),
    ),
    "steps": FigureText(
        "Quality against time",
        "Each mark is a number of steps. Where a curve is flat, further steps buy nothing.",
        (),
    ),
}
CAPTION = "Caption, to copy"
NUMBERS_HEADING = "Measures"
NUMBERS_HELP = (
    "Followed point: {point}. Lower jerk is smoother, not better: people who talk are not still. "
    "Alignment with beats means little without its chance level."
)
AS_GENERATED = "As generated"
FILTERED = "Filtered"
FILTER_SWITCH = "Filter of plots and measures, for all systems alike"
NEAREST_LEGEND = "nearest to the reference"
NO_REFERENCE_LEGEND = "Give a reference motion to see which system is nearest to it."
ALL_MEASURES = "Show all {count} measures"
CSV_LABEL = "Save as CSV"
GO_THERE = "Show {time}"

VIEW_NAMES = {
    "front": "From the front",
    "three_quarter": "From half the side",
    "side": "From the side",
    "face": "The face",
    "left_hand": "The left hand",
    "right_hand": "The right hand",
}
SAVE_RUN = "Save as a file"
SAVE_RUN_HELP = "Everything of this run in one zip; drop it on this page to open the run again."
SAVE_PAGE = "Save as a page"
SAVE_PAGE_HELP = (
    "Bodies, sound and time line in one HTML file that any browser plays, without this program."
)
RUN_KEPT = "Whoever has it can open it, for {minutes} minutes more."
COMPARE = "Compare the two that are ticked"
COMPARE_THIS = "Compare {title}"
COMPARE_HELP = "Tick two runs to see them together."
COMPARE_LAST = "Compare with your run before"
COMPARE_OTHER = "Compare with your run before, of other speech"
PAIR_LINK = "Link to this comparison"
PAIR_SAME_SETTINGS = "All settings are the same."
PAIR_BROUGHT = "{run} is motion from your files, which no system was asked for."
PAIR_ONE_SPEECH = "Both had the same speech, {speech}: they play together."
PAIR_ONLY_SEED = (
    "Same speech, same settings but for the seed: this is how far chance alone moved the numbers."
)
PAIR_OTHER_SPEECH = (
    "They did not have the same speech ({first} against {second}): choose whose sound plays, and "
    "mind that the numbers differ by the speech as well."
)
PAIR_LEGEND = "A is the earlier run. Differences are B less A."
PAIR_DIFFERENCE = "B \N{MINUS SIGN} A"
RUN_GONE = "This run is kept no longer: runs and their files are deleted after {minutes} minutes."

STAGE_NAMES = {
    "speech": "Read what was given",
    "motion": "Generate motion",
    "numbers": "Measure",
    "video": "Draw videos",
    "comparison": "Join side by side",
    "figure": "Draw the figure",
}
READY = "Ready."
STARTING = "Starting."
STARTING_SYSTEMS = "Starting, as soon as the models are read."
DONE = "Done in {seconds:.0f} s: {rows}, {frames} frames each at 30 per second."
SEEN_STARTING = "The video of the stage begins as soon as there is room."
SEEN_COMING = "The video of the stage is drawn: {share:.0%}."
SEEN_DONE = "The video of the stage is there: {bodies}, {seconds:.1f} s, {megabytes:.1f} MB."
SEEN_DAMAGED = "What the stage told of itself cannot be used: {why}"
PLAN_LABEL = "Plan of gestures (.json, .TextGrid or .eaf)"
EDITS_DAMAGED = "What the editor of gestures asked for cannot be read; load the page again."
EDITS_GONE = (
    "This run is kept no longer, or is another browser's; generate the motion again to edit it."
)
TOO_MANY_TAKES = "There are {limit} takes of this run already; generate the motion again for more."
TAKE_BEGINS = "It is performed again."
TAKE_COMING = "Take {number} is performed: it moves as far as it has come."
TAKE_DONE = "Take {number} is there."
EDITOR_BEGINS = "The editor reads the gestures and the models, once."
EDITOR_READY = "Choose a gesture on the time line, or add one."
SEEN_GONE = "A motion of the stage is kept no longer; start the run again, then make the video."
VIDEOS_LABEL = "Draw videos as well"
VIDEOS_HELP = "For a file to keep or to send; nobody waits for them, and the stage needs none."
VIDEOS_DONE = "Its videos are drawn."
VIDEOS_MISSING = "The saved run lacks {missing} of {count} videos: they are not drawn yet."
STOPPED = "Stopped. Nothing was kept."
CANCELLED = "Cancelled. Nothing was kept."
FAILED_TITLE = "This run stopped"
NOTES_TITLE = "Good to know"

CLIPS_LABEL = "Several clips at once"
CLIPS_HELP = (
    "Up to {count} files of at most {size} each and {max_min:g} minutes together: one run, a "
    "table with a row for each clip, and a verdict with its interval over clips. No videos are "
    "drawn; the speech above, if there is any, is one of them."
)
CLIP_OTHER = "{name} cannot be one of several clips; these are {known}."
OF_ONE_CLIP = (
    "A recorded motion, a transcript and a plan belong to one piece of speech; take them away, or "
    "generate that one alone."
)
CLIP = "Clip"
CLIPS_DONE = "{done} of {count} clips are done; any of them can be chosen below the table."
CLIPS_MEAN = "Mean [95 % interval over clips]"
NO_SPEECH = "There is no speech yet: upload or record some, or take an example."
TOO_MANY_VIDEOS = (
    "{systems} with {samples} of each make {count} bodies, with the reference if there is one; "
    "this page shows at most {limit}. Choose fewer."
)
DISK_FULL = "This machine has no room for more files just now; try again in a while."
FAULT = (
    "Something went wrong inside the program, not with your input. Please report it with this "
    "number: {fault_id}."
)
