/** Draws bodies into rectangles of one WebGL 2 canvas, lit as in the videos. */

import { NUM_JOINTS } from "./motion.js";

const LIGHTS = ["key", "fill", "rim"];
const LEAST_FACE = 3; // of 255
const JAW_OPEN = 0.4; // radians
const SLOW_TEXELS = 64; // of a shadow's side
const POSED = ["posed", "posed_normal", "jerk"]; // of a vertex, one after the other
const POSED_FLOATS = 7;

const HEAD = `#version 300 es
precision highp float;
precision highp int;
`;

/** Vertices are moved once for all panels and the shadow of a picture. */
const SKIN_VERTICES = `${HEAD}
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in uvec4 joints;
layout(location = 3) in vec4 weights;
uniform highp sampler2D joint_rows;  // line j: three rows of joint j's matrix, then its jerk
uniform int first_joint;
out vec3 posed;
out vec3 posed_normal;
out float jerk;
void main() {
    mat3x4 rows = mat3x4(0.0);
    jerk = 0.0;
    for (int i = 0; i < 4; i++) {
        if (weights[i] == 0.0) continue;
        int line = first_joint + int(joints[i]);
        for (int row = 0; row < 3; row++) {
            rows[row] += weights[i] * texelFetch(joint_rows, ivec2(row, line), 0);
        }
        jerk += weights[i] * texelFetch(joint_rows, ivec2(3, line), 0).x;
    }
    posed = vec4(position, 1.0) * rows;
    posed_normal = vec4(normal, 0.0) * rows;
}`;

const NO_FRAGMENTS = `${HEAD}
void main() {}`;

/** Textured bodies are shaded vertex by vertex as well: by light, which the texture is multiplied by, and gloss. */
const bodyShader = (lighting, isTextured) => `${HEAD}
${isTextured ? "#define TEXTURED" : ""}
#define MAX_DIRECTIONAL_LIGHTS ${LIGHTS.length}
#define HEATS 6
${lighting}
layout(location = 0) in vec3 posed;
layout(location = 1) in vec3 posed_normal;
layout(location = 2) in float jerk;
layout(location = 3) in vec4 color;
uniform mat4 clip_from_world;
uniform vec3 shift;
uniform vec3 heat_colors[HEATS];
uniform float heat_scale;  // jerk at the end of the scale; 0 shows the body's own colours
uniform vec4 ink;  // that it is printed in, dark where it is dark; the last is 0 of its own colours
uniform float floor_height;
out vec3 lit;
out float above;  // the floor
#ifdef TEXTURED
layout(location = 4) in vec2 texcoord;
out vec2 uv;
out vec3 gloss;
#endif

vec3 heat_color(float share) {
    float at = clamp(share, 0.0, 1.0) * float(HEATS - 1);
    int stop = min(int(at), HEATS - 2);
    vec3 display = mix(heat_colors[stop], heat_colors[stop + 1], at - float(stop));
    return display * display;
}

void main() {
    vec3 world = posed + shift;
    above = world.y - floor_height;
    gl_Position = clip_from_world * vec4(world, 1.0);
    vec3 base = heat_scale > 0.0 ? heat_color(jerk / heat_scale) : color.rgb;
    base *= material.base_color_factor.rgb;
#ifdef TEXTURED
    uv = texcoord;
    gloss = shade(world, normalize(posed_normal), vec3(0.0));
    lit = shade(world, normalize(posed_normal), base) - gloss;
#else
    lit = to_display(shade(world, normalize(posed_normal), base));
    vec3 print = mix(ink.rgb, vec3(1.0), dot(lit, vec3(0.2126, 0.7152, 0.0722)));
    lit = mix(lit, print, ink.a);
#endif
}`;

/** Of what the floor hides, a hint is left. */
const SUNK = `
in float above;
uniform bool hides;
vec4 sunk(vec3 display) {
    return hides && above < 0.0 ? vec4(mix(display, vec3(1.0), ink.a), 0.12) : vec4(display, 1.0);
}
`;

const BODY_FRAGMENTS = `${HEAD}
in vec3 lit;
uniform float inside;  // of a sleeve, dark; of a coarser mesh slivers are turned away that are none
uniform vec4 ink;
out vec4 frag_color;
${SUNK}
void main() {
    frag_color = sunk(gl_FrontFacing ? lit : inside * lit);
}`;

const TEXTURED_FRAGMENTS = (lighting) => `${HEAD}
#define MAX_DIRECTIONAL_LIGHTS ${LIGHTS.length}
${lighting}
in vec3 lit;
in vec3 gloss;
in vec2 uv;
uniform sampler2D picture;
uniform vec4 ink;
uniform float heat_scale;
out vec4 frag_color;
${SUNK}
void main() {
    vec4 texel = texture(picture, uv);
    if (texel.a < 0.5) discard;  // between the strands of hair
    vec3 own = heat_scale > 0.0 ? vec3(1.0) : texel.rgb;
    vec3 display = to_display(lit * own * own + gloss);
    vec3 print = mix(ink.rgb, vec3(1.0), dot(display, vec3(0.2126, 0.7152, 0.0722)));
    frag_color = sunk(mix(display, print, ink.a));
}`;

const SHADOW_VERTICES = `${HEAD}
layout(location = 0) in vec3 posed;
uniform vec3 ground;  // x and z of its middle, and the floor's height
uniform float half_size;
uniform vec2 slope;
out float height;
void main() {
    height = max(posed.y - ground.z, 0.0);
    gl_Position = vec4((posed.xz - slope * height - ground.xy) / half_size, 0.0, 1.0);
}`;

const SHADOW_FRAGMENTS = `${HEAD}
in float height;
uniform float touching;
out vec4 covered;
void main() {
    covered = vec4(1.0, height < touching ? 1.0 : 0.0, 0.0, 1.0);
}`;

const SCREEN_VERTICES = `${HEAD}
out vec2 uv;
void main() {
    uv = vec2(gl_VertexID == 1 ? 2.0 : 0.0, gl_VertexID == 2 ? 2.0 : 0.0);
    gl_Position = vec4(2.0 * uv - 1.0, 0.0, 1.0);
}`;

/** Both shadows are spread along one axis, each by its own Gaussian. */
const BLUR_FRAGMENTS = `${HEAD}
in vec2 uv;
uniform sampler2D covered;
uniform vec2 texel;
uniform vec2 sigmas;
uniform int radius;
out vec4 spread;
void main() {
    vec2 total = vec2(0.0), weight = vec2(0.0);
    for (int i = -radius; i <= radius; i++) {
        vec2 w = exp(-0.5 * float(i * i) / (sigmas * sigmas));
        total += w * texture(covered, uv + float(i) * texel).rg;
        weight += w;
    }
    spread = vec4(total / weight, 0.0, 1.0);
}`;

const GROUND_VERTICES = `${HEAD}
uniform mat4 clip_from_world;
uniform vec3 ground;
uniform float half_size;
uniform vec3 shift;
out vec2 at;  // -1 to 1
out vec2 place;
void main() {
    at = vec2((gl_VertexID & 1) == 0 ? -1.0 : 1.0, gl_VertexID < 2 ? -1.0 : 1.0);
    place = ground.xy + half_size * at;
    gl_Position = clip_from_world * vec4(vec3(place.x, ground.z, place.y) + shift, 1.0);
}`;

const GROUND_FRAGMENTS = `${HEAD}
in vec2 at;
uniform sampler2D shadow;
uniform vec3 background;
uniform vec2 glow;  // how much lighter the pool's middle is, and its lightest
uniform vec2 pool;  // power and fade
uniform vec3 lost;  // by the body, by what touches, at most
in vec2 place;  // in the world
uniform float grid;  // how strong its lines are
out vec4 frag_color;
void main() {
    float radius = length(at);
    float lightness = pow(clamp(1.0 - radius, 0.0, 1.0), pool.x);
    vec3 lit = mix(background, min(background + glow.x, glow.y), lightness);
    vec2 covered = texture(shadow, 0.5 * at + 0.5).rg;
    float dark = min(dot(lost.xy, covered), lost.z) * clamp((1.0 - radius) * pool.y, 0.0, 1.0);
    vec2 wide = fwidth(place);
    vec2 off = abs(fract(2.0 * place + 0.5) - 0.5) / (2.0 * wide);  // pixels from the nearest line of every half metre
    float line = grid * clamp(1.2 - min(off.x, off.y), 0.0, 1.0) * clamp(2.0 * (1.0 - radius), 0.0, 1.0);
    lit = mix(lit, background.r > 0.5 ? vec3(0.45) : vec3(0.8), line) * (1.0 - dark);
    frag_color = vec4(lit, 1.0);
}`;

const INK_VERTICES = `${HEAD}
layout(location = 0) in vec2 place;  // -1 to 1 in the panel
layout(location = 1) in vec3 color;
out vec3 ink;
void main() {
    ink = color;
    gl_Position = vec4(place, 0.0, 1.0);
}`;

const INK_FRAGMENTS = `${HEAD}
in vec3 ink;
out vec4 frag_color;
void main() {
    frag_color = vec4(ink, 1.0);
}`;

const GRID = 0.35; // of its lines

/** @type {[number, number, number]} */
const DARK = [0.115, 0.15, 0.19];

export class Painter {
  #background = DARK;
  #gl;
  #mesh;
  #facts;
  #programs;
  #attributes = {};
  #indices = new Map(); // faces -> buffer and its kind
  #bodies = []; // each { vertices, positions, buffer, feedback, posed, isPlain }
  #due = []; // bodies that have been posed, [number, how many vertices]
  #moved; // vertices that the face moves
  #order; // of each target: where its weight stands among a motion's
  #joints; // texture
  #picture = null; // texture of a character
  #texels = new Float32Array(0);
  #texelsAcross;
  #tone = "light"; // as the mesh comes
  #build; // { positions, normals } of all bodies at rest
  #shadow; // { texture, frame } three times: covered, half spread, spread
  #ink;

  /**
   * `isSlow` says that the processor draws.
   *
   * @param {WebGL2RenderingContext} gl
   * @param {import("./mesh.js").Mesh} mesh
   * @param {import("../messages").ViewerConstants} facts
   * @param {boolean} isSlow
   */
  constructor(gl, mesh, facts, isSlow) {
    this.#gl = gl;
    this.#mesh = mesh;
    this.#build = mesh;
    this.#facts = facts;
    const program = (...sources) => new Program(gl, ...sources);
    this.#programs = {
      skin: program(SKIN_VERTICES, NO_FRAGMENTS, POSED),
      body: program(bodyShader(facts.lighting, Boolean(mesh.uv)), mesh.uv ? TEXTURED_FRAGMENTS(facts.lighting) : BODY_FRAGMENTS),
      shadow: program(SHADOW_VERTICES, SHADOW_FRAGMENTS),
      blur: program(SCREEN_VERTICES, BLUR_FRAGMENTS),
      ground: program(GROUND_VERTICES, GROUND_FRAGMENTS),
      ink: program(INK_VERTICES, INK_FRAGMENTS),
    };
    this.#order = mesh.targets.map(({ name }) => facts.faces.indexOf(name));
    this.#moved = new Set(mesh.targets.flatMap(({ indices }) => Array.from(indices)));
    for (const name of ["normals", "colors", "joints", "weights"]) this.#attributes[name] = this.#filled(gl.ARRAY_BUFFER, mesh[name]);
    if (mesh.uv) this.#attributes.uv = this.#filled(gl.ARRAY_BUFFER, mesh.uv);
    if (mesh.picture) this.#picture = this.#pictured(mesh.picture);
    this.#joints = this.#texture(gl.NEAREST);
    this.#texelsAcross = isSlow ? SLOW_TEXELS : facts.ground.texels;
    this.#shadow = ["covered", "half", "spread"].map(() => this.#target(this.#texelsAcross));
    this.#ink = { buffer: gl.createBuffer(), vertices: gl.createVertexArray() };
    gl.bindVertexArray(this.#ink.vertices);
    this.#interleaved(this.#ink.buffer, [2, 3]);
    gl.bindVertexArray(null);
    this.#light();
  }

  #light() {
    const { studio, roughness, marks } = this.#facts;
    const { body } = this.#programs;
    const gl = this.#gl;
    gl.useProgram(body.handle);
    gl.uniform1i(body.at("n_directional_lights"), LIGHTS.length);
    LIGHTS.forEach((name, i) => {
      const { direction_to_light: towards, color, intensity } = studio[name];
      const length = Math.hypot(...towards);
      gl.uniform3fv(body.at(`directional_lights[${i}].direction`), towards.map((part) => -part / length));
      gl.uniform3fv(body.at(`directional_lights[${i}].color`), color);
      gl.uniform1f(body.at(`directional_lights[${i}].intensity`), intensity);
    });
    gl.uniform3fv(body.at("ambient_light"), [studio.ambient, studio.ambient, studio.ambient]);
    gl.uniform4fv(body.at("material.base_color_factor"), [1, 1, 1, 1]);
    gl.uniform1f(body.at("material.roughness_factor"), roughness);
    gl.uniform3fv(body.at("heat_colors"), marks.heat.flat());
  }

  /** Have all bodies in another tone, one of the facts' `tones`; as they are where there is none of that name. */
  setTone(tone) {
    const colors = this.#facts.tones[tone];
    if (tone === this.#tone || !colors || this.#mesh.uv) return;
    this.#tone = tone;
    this.#refill(this.#attributes.colors, this.#mesh.toned(this.#facts.tones.light, colors));
  }

  /** Have all bodies in another build: where their vertices are at rest. What follows is to be posed. */
  setBuild(build) {
    if (build === this.#build) return;
    this.#build = build;
    this.#refill(this.#attributes.normals, build.normals);
    for (const body of this.#bodies) {
      body.positions.set(build.positions);
      this.#refill(body.buffer, body.positions);
    }
  }

  /** How many bodies there are. */
  setBodies(count) {
    while (this.#bodies.length < count) this.#bodies.push(this.#newBody());
    this.#texels = new Float32Array(16 * NUM_JOINTS * count);
  }

  #newBody() {
    const gl = this.#gl;
    const positions = Float32Array.from(this.#build.positions);
    const buffer = this.#filled(gl.ARRAY_BUFFER, positions);
    const vertices = gl.createVertexArray();
    gl.bindVertexArray(vertices);
    this.#attribute(0, buffer, 3, gl.FLOAT);
    this.#attribute(1, this.#attributes.normals, 3, gl.FLOAT);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.#attributes.joints);
    gl.enableVertexAttribArray(2);
    gl.vertexAttribIPointer(2, 4, gl.UNSIGNED_BYTE, 0, 0);
    this.#attribute(3, this.#attributes.weights, 4, gl.UNSIGNED_SHORT);
    const place = this.#filled(gl.ARRAY_BUFFER, new Float32Array((POSED_FLOATS * positions.length) / 3));
    const posed = gl.createVertexArray();
    gl.bindVertexArray(posed);
    this.#interleaved(place, [3, 3, 1]);
    this.#attribute(3, this.#attributes.colors, 4, gl.UNSIGNED_SHORT);
    if (this.#attributes.uv) this.#attribute(4, this.#attributes.uv, 2, gl.FLOAT);
    gl.bindVertexArray(null);
    gl.bindBuffer(gl.ARRAY_BUFFER, null); // nothing else may have it while it is written to
    const feedback = gl.createTransformFeedback();
    gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, feedback);
    gl.bindBufferBase(gl.TRANSFORM_FEEDBACK_BUFFER, 0, place);
    gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, null);
    return { vertices, positions, buffer, feedback, posed, isPlain: true };
  }

  #attribute(location, from, width, kind) {
    const gl = this.#gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, from);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, width, kind, kind !== gl.FLOAT, 0, 0);
  }

  /** Numbers of several attributes, one vertex after the other. */
  #interleaved(buffer, widths) {
    const gl = this.#gl;
    const stride = 4 * widths.reduce((sum, width) => sum + width);
    let offset = 0;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    for (const [location, width] of widths.entries()) {
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, width, gl.FLOAT, false, stride, offset);
      offset += 4 * width;
    }
  }

  /**
   * Put a body's joints where `world` has them (3 x 4 matrices); `jerk` of each, or null; `faces`
   * are weights of 0 to 255, or null to leave the face alone; `levels` are those of its meshes that
   * are to be drawn. `upload` sends all to the card.
   */
  pose(number, world, jerk, faces, levels) {
    const texels = this.#texels;
    const { rest } = this.#mesh;
    for (let joint = 0; joint < NUM_JOINTS; joint++) {
      const to = 16 * (NUM_JOINTS * number + joint);
      const from = 12 * joint;
      for (let row = 0; row < 3; row++) {
        const [a, b, c, d] = [world[from + 4 * row], world[from + 4 * row + 1], world[from + 4 * row + 2], world[from + 4 * row + 3]];
        texels[to + 4 * row] = a;
        texels[to + 4 * row + 1] = b;
        texels[to + 4 * row + 2] = c;
        texels[to + 4 * row + 3] = d - a * rest[3 * joint] - b * rest[3 * joint + 1] - c * rest[3 * joint + 2];
      }
      texels[to + 12] = jerk ? jerk[joint] : 0;
    }
    const count = this.#mesh.numVertices(Math.min(...levels));
    const opened = this.#mesh.jawTarget < 0 ? 0 : jawOpening(world, this.#mesh.names);
    if (faces) this.#moveFace(this.#bodies[number], faces, count, opened);
    this.#due.push([number, count]);
  }

  upload() {
    const gl = this.#gl;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.#joints);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, 4, this.#texels.length / 16, 0, gl.RGBA, gl.FLOAT, this.#texels);
    const { skin } = this.#programs;
    gl.useProgram(skin.handle);
    gl.enable(gl.RASTERIZER_DISCARD);
    for (const [number, count] of this.#due) {
      const { vertices, feedback } = this.#bodies[number];
      gl.uniform1i(skin.at("first_joint"), NUM_JOINTS * number);
      gl.bindVertexArray(vertices);
      gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, feedback);
      gl.beginTransformFeedback(gl.POINTS);
      gl.drawArrays(gl.POINTS, 0, count);
      gl.endTransformFeedback();
    }
    gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, null);
    gl.disable(gl.RASTERIZER_DISCARD);
    gl.bindVertexArray(null);
    this.#due = [];
  }

  #moveFace(body, faces, count, opened) {
    const { targets } = this.#mesh;
    const { positions: rest } = this.#build;
    const weights = targets.map((_, i) => faces[this.#order[i]] + (i === this.#mesh.jawTarget ? 255 * opened : 0));
    const strong = targets.flatMap((target, i) => (weights[i] >= LEAST_FACE ? [[target, weights[i] / 255]] : []));
    if (!strong.length && body.isPlain) return;
    const { positions } = body;
    for (const vertex of this.#moved) for (let k = 3 * vertex; k < 3 * vertex + 3; k++) positions[k] = rest[k];
    for (const [{ indices, values }, weight] of strong) {
      for (let i = 0; i < indices.length; i++) {
        for (let k = 0; k < 3; k++) positions[3 * indices[i] + k] += weight * values[3 * i + k];
      }
    }
    body.isPlain = !strong.length && count === this.#mesh.numVertices(0);
    this.#refill(body.buffer, positions.subarray(0, 3 * count));
  }

  /** Everything in the colour of the background, which is dark in a dark page, but for a ghost, whose inks need a light one. */
  clear(isDark) {
    this.#background = isDark ? DARK : this.#facts.studio.background;
    const gl = this.#gl;
    gl.disable(gl.SCISSOR_TEST);
    gl.colorMask(true, true, true, true);
    gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
    gl.clearColor(...this.#background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  /** Make the shadow of one body ready for its panels. `ground` is that of Framing. */
  castShadow(number, level, { centre, floor, halfSize }) {
    const gl = this.#gl;
    const { touching, texels: usual } = this.#facts.ground;
    const texels = this.#texelsAcross;
    const blurs = this.#facts.ground.blurs.map((blur) => (blur * texels) / usual);
    const { shadow_from: from } = this.#facts.studio;
    const [covered, half, spread] = this.#shadow;
    gl.disable(gl.SCISSOR_TEST);
    gl.disable(gl.DEPTH_TEST);
    gl.colorMask(true, true, true, true);
    gl.viewport(0, 0, texels, texels);
    gl.bindFramebuffer(gl.FRAMEBUFFER, covered.frame);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    const { shadow, blur } = this.#programs;
    gl.useProgram(shadow.handle);
    gl.uniform3f(shadow.at("ground"), ...centre, floor);
    gl.uniform1f(shadow.at("half_size"), halfSize);
    gl.uniform2f(shadow.at("slope"), from[0] / from[1], from[2] / from[1]);
    gl.uniform1f(shadow.at("touching"), touching);
    gl.enable(gl.BLEND);
    gl.blendEquation(gl.MAX);
    this.#drawBody(number, this.#mesh.level(level));
    gl.disable(gl.BLEND);
    gl.blendEquation(gl.FUNC_ADD);
    gl.useProgram(blur.handle);
    gl.uniform2f(blur.at("sigmas"), ...blurs);
    gl.uniform1i(blur.at("radius"), Math.round(2.5 * Math.max(...blurs)));
    gl.activeTexture(gl.TEXTURE0);
    gl.bindVertexArray(null);
    for (const [source, target, texel] of [[covered, half, [1 / texels, 0]], [half, spread, [0, 1 / texels]]]) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
      gl.bindTexture(gl.TEXTURE_2D, source.texture);
      gl.uniform2f(blur.at("texel"), ...texel);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /**
   * `faces` of one body on its ground, in a rectangle of pixels from the upper left corner; `isWhole` says that they
   * are of the finest mesh.
   *
   * `clip` cuts the rectangle to a narrower one; `shift` moves body and ground; `heat` is the jerk
   * at the end of the scale, 0 for none; `ink` is a colour that the body is printed in, over what is
   * there if `isOver`; null leaves its own colours.
   */
  panel(rect, { matrix, eye, number, faces, isWhole, ground, clip = rect, shift = [0, 0, 0], heat = 0, ink = null, isOver = false }) {
    const gl = this.#gl;
    this.#frame(rect, clip);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    const isCameraAbove = eye[1] > ground.floor;
    if (!isOver && isCameraAbove) this.#drawGround(matrix, ground, shift);
    gl.enable(gl.DEPTH_TEST);
    const { body } = this.#programs;
    gl.useProgram(body.handle);
    if (this.#picture) {
      gl.activeTexture(gl.TEXTURE1);
      gl.bindTexture(gl.TEXTURE_2D, this.#picture);
      gl.uniform1i(body.at("picture"), 1);
      gl.activeTexture(gl.TEXTURE0);
    }
    gl.uniformMatrix4fv(body.at("clip_from_world"), true, matrix);
    gl.uniform3fv(body.at("cam_pos"), eye);
    gl.uniform3fv(body.at("shift"), shift);
    gl.uniform1f(body.at("heat_scale"), heat);
    gl.uniform1f(body.at("inside"), isWhole ? 0.35 : 1);
    gl.uniform4f(body.at("ink"), ...(ink ?? [0, 0, 0]), ink ? 1 : 0);
    gl.uniform1f(body.at("floor_height"), ground.floor);
    gl.uniform1i(body.at("hides"), Number(isCameraAbove));
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    if (isOver) {
      gl.blendEquation(gl.MIN);
      gl.colorMask(false, false, false, false);
      this.#drawBody(number, faces); // its depth: nothing behind it is printed
      gl.colorMask(true, true, true, true);
      gl.depthFunc(gl.LEQUAL);
    }
    this.#drawBody(number, faces);
    gl.depthFunc(gl.LESS);
    gl.disable(gl.BLEND);
    gl.blendEquation(gl.FUNC_ADD);
    gl.blendFunc(gl.ONE, gl.ZERO);
  }

  /** The floor with the shadow that was cast last. */
  #drawGround(matrix, ground, shift) {
    const gl = this.#gl;
    gl.disable(gl.DEPTH_TEST);
    const floor = this.#programs.ground;
    gl.useProgram(floor.handle);
    gl.uniformMatrix4fv(floor.at("clip_from_world"), true, matrix);
    gl.uniform3f(floor.at("ground"), ...ground.centre, ground.floor);
    gl.uniform1f(floor.at("half_size"), ground.halfSize);
    gl.uniform3fv(floor.at("shift"), shift);
    const { glow, lightest, pool_power: power, fade, lost, most_lost: most } = this.#facts.ground;
    gl.uniform3fv(floor.at("background"), this.#background);
    gl.uniform2f(floor.at("glow"), glow, lightest);
    gl.uniform2f(floor.at("pool"), power, fade);
    gl.uniform3f(floor.at("lost"), ...lost, most);
    gl.uniform1f(floor.at("grid"), ground.hasGrid ? GRID : 0);
    gl.bindVertexArray(null);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.#shadow[2].texture);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  /** Flat triangles over a panel: of each corner x and y (-1 to 1) and a colour. */
  ink(rect, corners, clip = rect) {
    if (!corners.length) return;
    const gl = this.#gl;
    this.#frame(rect, clip);
    gl.disable(gl.DEPTH_TEST);
    gl.useProgram(this.#programs.ink.handle);
    gl.bindVertexArray(this.#ink.vertices);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.#ink.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(corners), gl.STREAM_DRAW);
    gl.drawArrays(gl.TRIANGLES, 0, corners.length / 5);
  }

  #frame([left, top, width, height], [clipLeft, clipTop, clipWidth, clipHeight]) {
    const gl = this.#gl;
    const bottom = gl.drawingBufferHeight;
    gl.viewport(left, bottom - top - height, width, height);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(clipLeft, bottom - clipTop - clipHeight, Math.max(0, clipWidth), Math.max(0, clipHeight));
  }

  #drawBody(number, faces) {
    const gl = this.#gl;
    gl.bindVertexArray(this.#bodies[number].posed);
    if (!this.#indices.has(faces)) this.#indices.set(faces, this.#filled(gl.ELEMENT_ARRAY_BUFFER, faces));
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.#indices.get(faces));
    gl.drawElements(gl.TRIANGLES, faces.length, faces instanceof Uint16Array ? gl.UNSIGNED_SHORT : gl.UNSIGNED_INT, 0);
    gl.bindVertexArray(null);
  }

  #filled(target, content) {
    const gl = this.#gl;
    const buffer = gl.createBuffer();
    gl.bindBuffer(target, buffer);
    gl.bufferData(target, content, target === gl.ARRAY_BUFFER ? gl.DYNAMIC_DRAW : gl.STATIC_DRAW);
    return buffer;
  }

  #refill(buffer, content) {
    this.#gl.bindBuffer(this.#gl.ARRAY_BUFFER, buffer);
    this.#gl.bufferSubData(this.#gl.ARRAY_BUFFER, 0, content);
  }

  #texture(filter) {
    const gl = this.#gl;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, filter);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    return texture;
  }

  #pictured(picture) {
    const gl = this.#gl;
    const texture = this.#texture(gl.LINEAR);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, picture);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    gl.generateMipmap(gl.TEXTURE_2D);
    return texture;
  }

  #target(size) {
    const gl = this.#gl;
    const texture = this.#texture(gl.LINEAR);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RG8, size, size);
    const frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return { texture, frame };
  }
}

/** How far a jaw is open by its rotation from the head, 0 to 1, as renderer/body/body.py has it. */
function jawOpening(world, names) {
  const [head, jaw] = ["head", "jaw"].map((name) => 12 * names.indexOf(name));
  let trace = 0;
  for (const k of [0, 1, 2, 4, 5, 6, 8, 9, 10]) trace += world[head + k] * world[jaw + k];
  return Math.min(Math.acos(Math.max(-1, Math.min(1, (trace - 1) / 2))) / JAW_OPEN, 1);
}

/** A program and the places of its uniforms. */
class Program {
  #gl;
  #places = new Map();

  /** `written` are what the vertex shader leaves for another. */
  constructor(gl, vertices, fragments, written = []) {
    this.#gl = gl;
    this.handle = gl.createProgram();
    for (const [i, kind] of [gl.VERTEX_SHADER, gl.FRAGMENT_SHADER].entries()) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, [vertices, fragments][i]);
      gl.compileShader(shader);
      gl.attachShader(this.handle, shader);
      gl.deleteShader(shader); // goes with the program
    }
    gl.transformFeedbackVaryings(this.handle, written, gl.INTERLEAVED_ATTRIBS);
    gl.linkProgram(this.handle);
    if (gl.getProgramParameter(this.handle, gl.LINK_STATUS)) return;
    throw new Error(`This browser's 3D graphics do not work (${gl.getProgramInfoLog(this.handle)}).`);
  }

  at(name) {
    if (!this.#places.has(name)) this.#places.set(name, this.#gl.getUniformLocation(this.handle, name));
    return this.#places.get(name);
  }
}
