/** What the server writes as JSON for the page's modules, made by .ci/messages.py from
 * the types of the Python modules. Only the checks read this file. */

export type Vector = [number, number, number];

/** Value of a player, sent again whenever its run has grown; empty without a run. */
export interface PlayerValue {
  run?: string;
  rows?: PlayerRow[];
  audio?: string;
  /** URL of the `Timeline`. */
  timeline?: string;
  /** Sounds to choose from if the motions belong to different speeches. */
  sounds?: AudioTrack[];
  /** True if more will follow. */
  running?: boolean;
  /** True for an example that plays at once. */
  is_example?: boolean;
  /** True if it plays as soon as it can. */
  plays_when_ready?: boolean;
  noise?: ViewerNoise;
  editing?: PlanEditorState;
  /** Findings, the most severe first. */
  findings?: PlayerFinding[];
}

/** Content of ``timeline.json``. */
export interface Timeline {
  duration_s: number;
  fps: number;
  /** Magnitude of the waveform by bar, 0 to 100. */
  peaks: number[];
  onsets_s: number[];
  /** Time (s) and strength of the accents found by the speech encoder. */
  heard_accents: [number, number][];
  /** Title of the tracked point. */
  point: string;
  /** Curves by motion, filter and name. */
  curves: Record<string, Record<"raw" | "savgol", Record<string, Curve>>>;
  worst: WorstSecond[];
  words: TimeSpan[];
  words_origin: "given" | "aligned" | "recognised";
  phones: TimeSpan[];
  /** Time (s) and strength of annotated accents. */
  accents: [number, number][];
  /** Annotated intervals by tier. */
  gestures: Record<string, TimeSpan[]>;
}

/** Plan as the editor shows it. */
export interface PlanEditorData {
  gestures: EditableGesture[];
  style: Record<string, number>;
  /** Hands that usually make a gesture of each kind. */
  kinds: Record<string, "both" | "right">;
  /** Usual stroke ends by kind (m), relative to the chest. */
  places: Record<string, [number, number, number]>;
  /** Usual start and end of a gesture, relative to its stroke end (s). */
  around: [number, number];
  words: TimeSpan[];
}

/** All planned events of a motion, each list in order of time. */
export interface GesturePlan {
  duration_s: number;
  left: HandPhase[];
  right: HandPhase[];
  nods: Nod[];
  /** Gaze events. */
  looks: Gaze[];
  brows: Brow[];
  smiles: Smile[];
  blinks: Blink[];
  /** Intervals by the leg that bears the weight. */
  stands: Stance[];
  /** Intervals of foot contact. */
  planted: FootContact[];
}

/** One motion of a player. URLs are relative to the page. */
export interface PlayerRow {
  name: string;
  label?: string;
  color: string;
  /** Stem of the names of its files. */
  stem: string;
  is_reference: boolean;
  /** Key that motions of the same noise share; null if the noise is not known. */
  noise_key: string | null;
  /** Run of the motion in a comparison of two. */
  compared_run?: string;
  /** URL of the whole motion (.npz). */
  motion?: string;
  /** URL of the frames so far, as binary messages. */
  frames?: string;
  frames_available?: FramesAvailable;
  video?: string;
  /** True if the row will have a video. */
  will_have_video?: boolean;
  /** URL of its gesture plan. */
  plan?: string;
  /** True if the system followed the plan; otherwise it was detected. */
  is_planned?: boolean;
  /** Number of the take of an edited plan. */
  take_number?: number;
  /** Original row of a take. */
  original_row?: string;
  /** Rotations to which the viewer adds noise. */
  noise_space?: "local" | "global";
  interpretation?: FileReading;
}

/** Audio track of a comparison of two runs. */
export interface AudioTrack {
  label: string;
  audio_url: string;
  timeline_url: string;
}

/** Noise that the viewer adds to rotations. */
export interface ViewerNoise {
  /** Standard deviation about each axis until the slider is moved (rad). */
  initial_rad: number;
  range: [number, number];
  has_slider: boolean;
}

/** State of the plan editor. */
export interface PlanEditorState {
  /** Original rows of the run that can be edited. */
  rows: string[];
  /** Rows from which edits can start, by name. */
  editable: Record<string, EditableRow>;
  /** Message on the last edit. */
  message: string;
  is_refused: boolean;
  /** True while a take is generated. */
  is_working: boolean;
  suggestions: EditSuggestionJson[];
}

/** Finding of a motion. */
export interface PlayerFinding {
  /** Name of the motion; empty for a statement on the motions without findings. */
  motion_name: string;
  sentence: string;
  /** Time (s) at which it is worst. */
  worst_time_s: number | null;
  /** Body part that shows it; empty for the whole body. */
  part: "" | "feet" | "hands" | "face";
}

/** Magnitude of a derivative at equal steps of time (s). */
export interface Curve {
  start_s: number;
  step_s: number;
  values: number[];
}

/** Second with the highest jerk, or with a joint that snaps. */
export interface WorstSecond {
  /** Name of the motion. */
  name: string;
  start_s: number;
  end_s: number;
  jerk_m_s3?: number;
  joint?: string;
  /** Angle by which the joint jumps. */
  snap_deg?: number;
  /** True if the snap is the most severe finding of its motion. */
  is_gravest?: boolean;
}

export type TimeSpan = [number, number, string];

/** Gesture in the plan editor (s). */
export interface EditableGesture {
  side: "left" | "right";
  start: number;
  end: number;
  /** End of the stroke. */
  lands: number;
  /** Duration of the holds after the stroke. */
  hold: number;
  kind: string;
  /** Stroke end of the other hand's part if the gesture is of both hands. */
  partner: number | null;
}

/** One phase of a hand's movement. */
export interface HandPhase {
  start_s: number;
  end_s: number;
  phase: "rest" | "preparation" | "stroke" | "hold" | "beat" | "retraction";
  /** Position of the wrist at the end (out, up, forward) in metres; a hold may drift a little. */
  goal: [number, number, number];
  /** Name of the gesture form, one of `model.plan.kinds.USUAL_STROKE_GOALS`; empty at rest. */
  kind: string;
  /** Word during which a stroke ends; no lexical affiliate. */
  word: string;
}

/** A nod of the head: down to its lowest point, and up again. */
export interface Nod {
  time_s: number;
  depth_deg: number;
}

/** Direction of the eyes and the head. */
export interface Gaze {
  start_s: number;
  end_s: number;
  /** Angle to the body's left (degrees); 0 is the listener. */
  yaw_deg: number;
  /** Angle downwards (degrees). */
  pitch_deg: number;
}

/** A movement of the brows, up or to a frown. */
export interface Brow {
  time_s: number;
  /** Height, 0 to 1; a frown is below 0. */
  height: number;
}

/** A smile of constant size. */
export interface Smile {
  start_s: number;
  end_s: number;
  /** Size, 0 to 1. */
  size: number;
}

/** A blink of both eyes. */
export interface Blink {
  time_s: number;
}

/** Stance: the leg that carries the body's weight. */
export interface Stance {
  start_s: number;
  end_s: number;
  leg: "left" | "right" | "both";
}

/** A foot that does not move. */
export interface FootContact {
  start_s: number;
  end_s: number;
  foot: "left" | "right";
}

/** Number of frames of a row so far, and their root transform. */
export interface FramesAvailable {
  num_ready: number;
  num_frames: number;
  /** Size so far (bytes) of the row's ``frames`` file. */
  num_bytes: number;
  /** Rotation about the vertical (rad), then translation (m). */
  root_transform: [number, number, number, number];
}

/** Interpretation of an imported file. */
export interface FileReading {
  /** Pattern of its name, such as "*.npz". */
  file_pattern: string;
  assumptions: AssumptionRecord[];
}

export interface EditableRow {
  of: string;
  from: string;
  editor: string;
}

/** Alternative to an edit that was refused. */
export interface EditSuggestionJson {
  label: string;
  edits: Record<string, unknown>[];
}

/** Interpretation of a file in one respect; see `model.formats.reading.Assumption`. */
export interface AssumptionRecord {
  kind: string;
  value: string;
  reason: string;
  confidence: "user" | "stated" | "sure" | "likely" | "unsure";
  alternatives: string[];
}

export interface ViewerConstants {
  lighting: string;
  studio: {
    key: {
      direction_to_light: Vector;
      color: Vector;
      intensity: number;
    };
    fill: {
      direction_to_light: Vector;
      color: Vector;
      intensity: number;
    };
    rim: {
      direction_to_light: Vector;
      color: Vector;
      intensity: number;
    };
    ambient: number;
    background: Vector;
    shadow_from: Vector;
  };
  roughness: number;
  camera: {
    yfov: number;
    near: number;
    margin: number;
  };
  views: Record<string, Vector[]>;
  joints: string[];
  close_ups: Record<string, {
    view: string;
    joints: number[];
    drawn: number[];
  }[]>;
  framing: {
    below_knees: string[];
    knee_flesh: number;
    fingertip: number;
    follow_beyond: number;
    lead: number;
    close_lead: number;
    middle: number;
    walk_sigma: number;
    face_sigma: number;
    hand_sigma: number;
  };
  ground: {
    half_size: number;
    texels: number;
    touching: number;
    lost: [number, number];
    blurs: [number, number];
    most_lost: number;
    glow: number;
    lightest: number;
    pool_power: number;
    fade: number;
  };
  marks: {
    heat: Vector[];
    speed: Vector[];
    spike: Vector;
    trail_frames: number;
    tips: Record<string, {
      joint: number;
      vertex: number;
    }>;
  };
  faces: string[];
  reaches: string;
  exaggeration: {
    cutoff: number;
    max_turn: number;
  };
  scales: {
    speed: number;
  };
  points: Record<string, string>;
  usual_point: string;
  tones: Record<string, Record<string, Vector>>;
  builds: {
    names: string[];
    step: number;
  };
}
