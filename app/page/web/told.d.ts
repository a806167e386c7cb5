/** What the server writes and the page's modules read, as JSON. Only the checks read this file. */

/** Start and end in seconds, and what is said or done. */
export type Interval = [number, number, string];

/** Of one motion: app/page/results/player.py and app/run/output/run_folder.py. Addresses are relative to the page. */
export interface Row {
  name: string;
  label?: string;
  color: string;
  stem: string;
  is_reference: boolean;
  /** What it shares with those that were drawn from the same noise. */
  noise: string | null;
  run?: string;
  motion?: string;
  /** Address of the motion as "Live frames", one message after the other. */
  frames?: string;
  /** How much of it there is so far. */
  there?: There;
  video?: string;
  /** Whether it will have one. */
  is_drawn?: boolean;
  /** Address of its `Plan`, and whether the system was given that. */
  plan?: string;
  is_planned?: boolean;
  /** Number of a take of an edited plan, and the row that it is of. */
  take?: number;
  of?: string;
  /** Rotations that the stage's noise is added to. */
  space?: "local" | "global";
  /** How its file was understood, as model/formats/read.py has it; `kind` as "*.npz". */
  assumed?: { kind: string; read: Assumption[] };
}

export interface Assumption {
  what: string;
  value: string;
  why: string;
  sure: "told" | "stated" | "sure" | "likely" | "unsure";
  others: string[];
}

/** app/page/results/player.py */
export interface Editing {
  /** The run's own rows that can be edited. */
  rows: string[];
  /** By row what edits can start from. `from` is the row whose plan was changed, `told` the address of
   * an `EditorTold`. */
  known: Record<string, { of: string; from: string; told: string }>;
  said: string;
  refused: boolean;
  state: string;
  /** What can be done in place of what was refused. */
  offers: { label: string; edits: object[] }[];
}

/** Of one plan: app/run/plan_edits/edited_motion.py. */
export interface EditorTold {
  gestures: { side: "left" | "right"; start: number; end: number; lands: number; hold: number; kind: string; partner: number | null }[];
  style: Record<string, number>;
  /** Each with the hands that usually make it, and where from the chest it ends; and how long before and after it lands it begins and ends. */
  kinds: Record<string, "right" | "both">;
  places: Record<string, Vector>;
  around: [number, number];
  words: Interval[];
}

export interface HandPhase {
  start_s: number;
  end_s: number;
  phase: "rest" | "preparation" | "stroke" | "hold" | "beat" | "retraction";
  /** Of the gesture; empty where none is known. */
  kind: string;
  /** That a stroke lands on; empty where none is known. */
  word: string;
}

/** What model/plan/plan.py writes, and, as the player adds, where it comes from. */
export interface Plan {
  origin: "planned" | "found";
  duration_s: number;
  left: HandPhase[];
  right: HandPhase[];
  nods: { time_s: number; depth_deg: number }[];
  looks: { start_s: number; end_s: number; yaw_deg: number; pitch_deg: number }[];
  brows: { time_s: number; height: number }[];
  smiles: { start_s: number; end_s: number; size: number }[];
  blinks: { time_s: number }[];
  stands: { start_s: number; end_s: number; leg: "left" | "right" | "both" }[];
}

/** Part of a plan: one of its lists, and which of that. */
export interface Chosen {
  list: "left" | "right" | "nods" | "looks" | "brows" | "smiles" | "blinks" | "stands";
  index: number;
}

export interface There {
  /** Frames in the file so far, and in the end. */
  end: number;
  num_frames: number;
  /** Of the file so far. */
  bytes: number;
  /** How the motion is laid onto the others: radians about the vertical, then metres. */
  place: [number, number, number, number];
}

/** app/page/results/run_pair.py */
export interface Sound {
  label: string;
  audio: string;
  timeline: string;
}

/** All that is known of a run, sent again as it grows. */
export interface Value {
  run?: string;
  rows?: Row[];
  audio?: string;
  timeline?: string;
  /** Of which one is chosen, where motions of other speech stand beside each other. */
  sounds?: Sound[];
  /** That more of it is being made. */
  running?: boolean;
  /** An example that plays at once. */
  plays?: boolean;
  /** Noise on both bodies at first (rad), its limits, and whether its slider is here. */
  noise?: { rad: number; range: [number, number]; has_slider: boolean };
  /** That it plays as soon as it can. */
  begins?: boolean;
  /** Where its gestures can be edited. */
  editing?: Editing;
  /** What stands out, the gravest first. */
  findings?: { name: string; sentence: string; at: number | null }[];
}

export interface Curve {
  start_s: number;
  step_s: number;
  values: number[];
}

/** app/run/timeline.py */
export interface TimelineData {
  duration_s: number;
  fps: number;
  peaks: number[];
  onsets_s: number[];
  point: string;
  /** By row, filter and kind. */
  curves: Record<string, Record<string, Record<string, Curve>>>;
  worst: { name: string; [told: string]: unknown }[];
  words: Interval[];
  words_origin: string;
  phones: Interval[];
  /** That somebody wrote down, and that our speech encoder hears: seconds and strength. */
  accents: [number, number][];
  heard_accents: [number, number][];
  gestures: Record<string, Interval[]>;
}

export interface Shot {
  view: string;
  /** That the camera looks at. */
  joints: number[];
  drawn: number[];
}

export interface Light {
  towards: Vector;
  color: Vector;
  intensity: number;
}

export type Vector = [number, number, number];

/** By which numbers videos are drawn: renderer/video/render_constants.py and app/page/routes/media.py. */
export interface Facts {
  lighting: string;
  studio: { key: Light; fill: Light; rim: Light; ambient: number; background: Vector; shadow_from: Vector };
  roughness: number;
  camera: { yfov: number; near: number; margin: number };
  /** Right, up and backward of the camera of each view. */
  views: Record<string, [Vector, Vector, Vector]>;
  joints: string[];
  close_ups: { face: Shot[]; hands: Shot[] };
  framing: Record<"knee_flesh" | "fingertip" | "follow_beyond" | "middle" | "walk_sigma" | "face_sigma" | "hand_sigma", number> & { below_knees: string[] };
  ground: Record<"half_size" | "texels" | "touching" | "most_lost" | "glow" | "lightest" | "pool_power" | "fade", number>
    & Record<"lost" | "blurs", [number, number]>;
  marks: {
    heat: Vector[];
    speed: Vector[];
    spike: Vector;
    tips: Record<string, { joint: number; vertex: number }>;
  };
  faces: string[];
  /** By the name of a tone the colour of each region of the body, linear, 0 to 1. */
  tones: Record<string, Record<string, Vector>>;
  /** Names, that of the mesh first, and the step of the others' offsets in metres. */
  builds: { names: string[]; step: number };
  /** Poses that live motion hardly leaves, at rest first: "Live frames", in base64. */
  reaches: string;
  exaggeration: { cutoff: number; max_turn: number };
  scales: { speed: number };
  points: Record<string, string>;
}
