/** What the server writes and the page's modules read, as JSON. Only the checks read this file. */

/** Start and end in seconds, and what is said or done. */
export type Interval = [number, number, string];

/** Of one motion: app/page/results/player.py. Addresses are relative to the page. */
export interface Row {
  name: string;
  label?: string;
  color: string;
  /** On and off lengths; none of a solid line. */
  dashes: number[];
  stem: string;
  is_reference: boolean;
  /** What it shares with those that were drawn from the same noise. */
  noise: string | null;
  run?: string;
  layout?: Layout;
  motion?: string;
  frames?: string;
  poster?: string;
  video?: string;
}

/** Upper and lower edges in a video, as shares of its height. */
export interface Layout {
  aspect: number;
  body: [number, number];
  face?: [number, number];
  hands?: [number, number];
}

/** All that is known of a run, sent again as it grows. */
export interface Value {
  run?: string;
  rows?: Row[];
  layout?: Layout | null;
  audio?: string;
  timeline?: string;
  running?: boolean;
  /** An example that plays at once. */
  plays?: boolean;
  /** That it plays as soon as it can. */
  begins?: boolean;
  paired?: boolean;
  /** What stands out, the gravest first. */
  findings?: { name: string; sentence: string; at: number | null }[];
}

export interface Curve {
  start_s: number;
  step_s: number;
  values: number[];
}

/** app/page/results/timeline.py */
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

/** By which numbers videos are drawn: renderer/video/facts.py and app/page/serving/stage_route.py. */
export interface Facts {
  lighting: string;
  studio: { key: Light; fill: Light; rim: Light; ambient: number; background: Vector; shadow_from: Vector };
  roughness: number;
  camera: { yfov: number; near: number; margin: number };
  /** Right, up and backward of the camera of each view. */
  views: Record<string, [Vector, Vector, Vector]>;
  joints: string[];
  close_ups: { face: Shot[]; hands: Shot[] };
  framing: {
    below_knees: string[];
    knee_flesh: number;
    fingertip: number;
    follow_beyond: number;
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
    tips: Record<string, { joint: number; vertex: number }>;
  };
  faces: string[];
  exaggeration: { cutoff: number; max_turn: number };
  scales: { jerk: number; speed: number };
  points: Record<string, string>;
  usual_point: string;
}
