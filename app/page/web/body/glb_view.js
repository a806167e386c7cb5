/**
 * A small viewer of the skinned, animated GLB files that renderer/files/glb.py writes. A pose can
 * also be told from outside, frame by frame: then the file only brings the body.
 *
 * It draws when asked to and never by itself: a page without a GPU stays responsive, and whoever
 * holds the clock (a video, a slider) decides what is seen. Of glTF 2.0 it reads what that writer
 * uses: one mesh with four joints a vertex, sparse morph targets, linear samplers, one camera.
 *
 *     const view = new GlbView(canvas);   // the picture has canvas.width x canvas.height pixels
 *     await view.load("motion.glb");
 *     view.seek(1.5);
 *     view.dispose();
 */

import { isSoftware, linked } from "./gl.js";
import { fetched, readGlb, WIDTHS } from "./glb.js";
import { product, rigid } from "./rigid.js";

const BACKGROUND = [0.894, 0.902, 0.918]; // of the videos
const ATTRIBUTES = ["POSITION", "NORMAL", "COLOR_0", "JOINTS_0", "WEIGHTS_0"]; // by location
const SMALLEST_WEIGHT = 1e-4;

const VERTEX_SHADER = `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 color;
layout(location = 3) in uvec4 joints;
layout(location = 4) in vec4 weights;
uniform mat4 clip_from_world;
uniform highp sampler2D joint_rows;  // line j holds the three rows of joint j's 3 x 4 matrix
out vec3 lit;

const vec3 TO_LIGHT = normalize(vec3(2.6, 2.0, 1.7));
const vec3 LIGHT = vec3(1.18, 1.12, 1.04);
const vec3 SKY = vec3(0.42, 0.46, 0.54);
const vec3 GROUND = vec3(0.16, 0.15, 0.15);

void main() {
    mat3x4 rows = mat3x4(0.0);
    for (int i = 0; i < 4; i++) {
        if (weights[i] == 0.0) continue;
        for (int row = 0; row < 3; row++) {
            rows[row] += weights[i] * texelFetch(joint_rows, ivec2(row, joints[i]), 0);
        }
    }
    gl_Position = clip_from_world * vec4(vec4(position, 1.0) * rows, 1.0);
    vec3 n = normalize(vec4(normal, 0.0) * rows);
    float diffuse = max((dot(n, TO_LIGHT) + 0.2) / 1.2, 0.0);
    vec3 linear = color.rgb * (LIGHT * diffuse + mix(GROUND, SKY, 0.5 * n.y + 0.5));
    lit = sqrt(clamp(1.12 * linear / (1.0 + 0.22 * linear), 0.0, 1.0));  // as in the videos
}`;

const FRAGMENT_SHADER = `#version 300 es
precision mediump float;
in vec3 lit;
out vec4 frag_color;
void main() {
    frag_color = vec4(gl_FrontFacing ? lit : 0.35 * lit, 1.0);  // the inside of a sleeve is dark
}`;

export class GlbView {
  #canvas;
  #gl;
  #program;
  #model = null;
  #loading = new AbortController();
  #fence = null; // behind the last picture

  /** Whether the processor has to draw, as there is no GPU: a tenth of a second a picture. */
  isSlow;
  /** An Orbit that moves the file's camera; null leaves it where it is. */
  orbit = null;

  /**
   * `antialias` smooths edges, which takes a processor that draws three times as long.
   * Throws an Error that holds a sentence if the browser has no WebGL 2.
   */
  constructor(canvas, { antialias = true } = {}) {
    this.#canvas = canvas;
    this.#gl = canvas.getContext("webgl2", { alpha: false, antialias });
    if (!this.#gl) throw new Error("This browser shows no 3D graphics (WebGL 2).");
    this.isSlow = isSoftware(this.#gl);
    this.#gl.clearColor(...BACKGROUND, 1);
    this.#gl.clear(this.#gl.COLOR_BUFFER_BIT); // not black until the first picture
    this.#program = linked(this.#gl, VERTEX_SHADER, FRAGMENT_SHADER);
  }

  /** Seconds from the first frame to the last; 0 before a file is loaded. */
  get duration() {
    return this.#model ? this.#model.motion.duration : 0;
  }

  /**
   * Fetch a file, to be shown in place of the one before.
   * Rejects with an Error that holds a sentence; also when a later `load` or `dispose` ended it.
   */
  async load(url) {
    this.#loading.abort(new Error("Another 3D file was asked for."));
    this.#loading = new AbortController();
    const content = await fetched(url, this.#loading.signal);
    let model;
    try {
      model = new Model(this.#gl, readGlb(content));
    } catch (cause) {
      throw new Error("The 3D file is damaged, or was not made by this app.", { cause });
    }
    this.#model?.delete();
    this.#model = model;
  }

  /** Names of the face's morph targets, in the order in which `pose` takes their weights. */
  get faces() {
    return this.#model ? this.#model.faces : [];
  }

  /** Draw the moment so many seconds after the first frame, or the nearest there is. */
  seek(seconds) {
    this.#draw((motion) => motion.moveTo(seconds));
  }

  /**
   * Draw a pose: `position` of the root besides its place in the file, `rotations` of all joints to
   * their parents (x, y, z, w of one after the other, of any length), `weights` of the face.
   */
  pose(position, rotations, weights) {
    this.#draw((motion) => motion.moveAs(position, rotations, weights));
  }

  /** The same pose, after `orbit` has moved. */
  redraw() {
    this.#draw(() => {});
  }

  #draw(move) {
    const gl = this.#gl;
    if (!this.#model || gl.isContextLost()) return;
    const { width, height } = this.#canvas;
    gl.viewport(0, 0, width, height);
    gl.clearColor(...BACKGROUND, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.#program);
    move(this.#model.motion);
    const camera = this.#model.place(width / height, this.orbit);
    gl.uniformMatrix4fv(gl.getUniformLocation(this.#program, "clip_from_world"), true, camera);
    this.#model.draw();
    gl.deleteSync(this.#fence);
    this.#fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
  }

  /** Whether the last picture is still being drawn. */
  get isDrawing() {
    const gl = this.#gl;
    return !!this.#fence && !gl.isContextLost() && gl.getSyncParameter(this.#fence, gl.SYNC_STATUS) !== gl.SIGNALED;
  }

  /** Free everything, and end a `load` under way. The canvas cannot be drawn on again. */
  dispose() {
    this.#loading.abort(new Error("The 3D view was closed."));
    this.#model = null;
    this.#gl.getExtension("WEBGL_lose_context")?.loseContext(); // frees what it holds
  }
}

/** Whether the processor would have to draw here. */
export function isDrawingSlow() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const isSlow = !!gl && isSoftware(gl);
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return isSlow;
}

// ---------------------------------------------------------------- what moves

/** The nodes of a file at one moment: where each stands, and the weights of the morph targets. */
class Motion {
  #nodes;
  #order = []; // of nodes, parents before children
  #times; // shared by all channels
  #channels;
  #root; // where the file puts it
  weights;

  constructor({ document, array }) {
    this.#nodes = document.nodes.map(({ translation = [0, 0, 0], rotation = [0, 0, 0, 1] }) => {
      return { translation, rotation, parent: null, world: null };
    });
    const ahead = document.scenes[0].nodes.map((node) => ({ node, parent: null }));
    for (const { node, parent } of ahead) {
      this.#nodes[node].parent = parent;
      this.#order.push(this.#nodes[node]);
      const children = document.nodes[node].children ?? [];
      ahead.push(...children.map((child) => ({ node: child, parent: this.#nodes[node] })));
    }
    this.#root = this.#nodes[0].translation;
    this.weights = document.meshes[0].weights ?? [];
    const { channels, samplers } = document.animations[0];
    this.#times = array(samplers[0].input);
    this.#channels = channels.map(({ sampler, target: { node, path } }) => {
      const { output } = samplers[sampler];
      const scale = document.accessors[output].normalized ? 1 / 32767 : 1;
      return { node, path, values: array(output), scale };
    });
  }

  get duration() {
    return this.#times[this.#times.length - 1];
  }

  /** Where a node stands: a 3 x 4 matrix, row by row. */
  world(node) {
    return this.#nodes[node].world;
  }

  moveTo(seconds) {
    const times = this.#times;
    const last = times.length - 1;
    const after = times.findIndex((time) => time > seconds);
    const [a, b] = after < 0 ? [last, last] : [Math.max(after - 1, 0), after];
    const share = a === b ? 0 : Math.max(0, (seconds - times[a]) / (times[b] - times[a]));
    for (const { node, path, values, scale } of this.#channels) {
      const width = values.length / times.length;
      const value = Array.from({ length: width }, (_, i) => {
        return scale * ((1 - share) * values[a * width + i] + share * values[b * width + i]);
      });
      if (path === "weights") this.weights = value;
      else this.#nodes[node][path] = value;
    }
    this.#stand();
  }

  /** See `GlbView.pose`. */
  moveAs(position, rotations, weights) {
    for (let joint = 0; 4 * joint < rotations.length; joint++) {
      this.#nodes[joint].rotation = Array.from(rotations.subarray(4 * joint, 4 * joint + 4));
    }
    this.#nodes[0].translation = this.#root.map((place, i) => place + position[i]);
    this.weights = weights;
    this.#stand();
  }

  /** From what each node is to its parent to where it stands. */
  #stand() {
    for (const node of this.#order) {
      const local = rigid(node.rotation, node.translation);
      node.world = node.parent ? product(node.parent.world, local) : local;
    }
  }
}

/** How far in front of a camera something stands; both 3 x 4 matrices. */
function depth(camera, other) {
  return [0, 4, 8].reduce((sum, row) => sum + camera[row + 2] * (camera[row + 3] - other[row + 3]), 0);
}

/** The 4 x 4 matrix, row by row, of a camera at `world`, whose picture is never cut narrower. */
function clipFromWorld(world, { yfov, aspectRatio, znear }, aspect) {
  const tangent = Math.tan(yfov / 2) * Math.max(1, aspectRatio / aspect);
  const eye = [world[3], world[7], world[11]];
  const [right, up, back] = [0, 1, 2].map((axis) => {
    const direction = [world[axis], world[4 + axis], world[8 + axis]];
    return [...direction, -direction.reduce((sum, part, i) => sum + part * eye[i], 0)];
  });
  const forward = back.map((part) => -part);
  return [
    ...right.map((part) => part / (tangent * aspect)),
    ...up.map((part) => part / tangent),
    ...forward.map((part, i) => (i === 3 ? part - 2 * znear : part)), // nothing is too far away
    ...forward,
  ];
}

// ---------------------------------------------------------------- what is drawn

/** The body of a file, in one WebGL context. */
class Model {
  #gl;
  #joints; // the node of each, and its inverse bind matrix
  #camera; // its node, its lens, and how far away the pelvis is at first
  #rest; // positions
  #targets; // each { indices, values }
  #buffers = {};
  #vertices;
  #faces;
  #texture;

  constructor(gl, file) {
    const { document, array } = file;
    const [skin] = document.skins;
    const primitive = document.meshes[0].primitives[0];
    this.faces = document.meshes[0].extras?.targetNames ?? [];
    this.motion = new Motion(file);
    const binds = array(skin.inverseBindMatrices);
    this.#joints = skin.joints.map((node, joint) => {
      const bind = Array.from({ length: 12 }, (_, i) => binds[16 * joint + 4 * (i % 4) + (i >> 2)]);
      return { node, bind };
    });
    const node = document.nodes.findIndex(({ camera }) => camera === 0);
    this.motion.moveTo(0);
    const distance = depth(this.motion.world(node), this.motion.world(skin.joints[0]));
    this.#camera = { node, lens: document.cameras[0].perspective, distance };
    this.#rest = array(primitive.attributes.POSITION);
    this.#targets = (primitive.targets ?? []).map(({ POSITION }) => array(POSITION));
    this.#gl = gl;
    this.#texture = gl.createTexture();
    this.#vertices = gl.createVertexArray();
    gl.bindVertexArray(this.#vertices);
    ATTRIBUTES.forEach((name, location) => {
      const { componentType, type, normalized } = document.accessors[primitive.attributes[name]];
      this.#upload(name, gl.ARRAY_BUFFER, array(primitive.attributes[name]));
      gl.enableVertexAttribArray(location);
      if (name === "JOINTS_0") gl.vertexAttribIPointer(location, 4, componentType, 0, 0);
      else gl.vertexAttribPointer(location, WIDTHS[type], componentType, !!normalized, 0, 0);
    });
    this.#upload("faces", gl.ELEMENT_ARRAY_BUFFER, array(primitive.indices));
    this.#faces = document.accessors[primitive.indices];
  }

  /** Move body and face to where `motion` is; gives the matrix of the camera there. */
  place(aspect, orbit) {
    if (this.#targets.length) this.#moveFace();
    this.#moveJoints();
    const { node, lens, distance } = this.#camera;
    const own = this.motion.world(node);
    return clipFromWorld(orbit ? orbit.from(own, distance) : own, lens, aspect);
  }

  draw() {
    const gl = this.#gl;
    gl.bindVertexArray(this.#vertices);
    gl.drawElements(gl.TRIANGLES, this.#faces.count, this.#faces.componentType, 0);
  }

  delete() {
    const gl = this.#gl;
    for (const buffer of Object.values(this.#buffers)) gl.deleteBuffer(buffer);
    gl.deleteVertexArray(this.#vertices);
    gl.deleteTexture(this.#texture);
  }

  #upload(name, target, content) {
    const gl = this.#gl;
    this.#buffers[name] = gl.createBuffer();
    gl.bindBuffer(target, this.#buffers[name]);
    gl.bufferData(target, content, gl.STATIC_DRAW);
  }

  #moveFace() {
    const positions = this.#rest.slice();
    this.#targets.forEach(({ indices, values }, target) => {
      const weight = this.motion.weights[target];
      if (Math.abs(weight) < SMALLEST_WEIGHT) return;
      indices.forEach((vertex, i) => {
        for (let k = 0; k < 3; k++) positions[3 * vertex + k] += weight * values[3 * i + k];
      });
    });
    this.#gl.bindBuffer(this.#gl.ARRAY_BUFFER, this.#buffers.POSITION);
    this.#gl.bufferSubData(this.#gl.ARRAY_BUFFER, 0, positions);
  }

  #moveJoints() {
    const gl = this.#gl;
    const rows = this.#joints.flatMap(({ node, bind }) => product(this.motion.world(node), bind));
    gl.bindTexture(gl.TEXTURE_2D, this.#texture);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
      gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST); // floats have no other
    }
    const [width, height] = [3, this.#joints.length];
    const texels = new Float32Array(rows);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, height, 0, gl.RGBA, gl.FLOAT, texels);
  }
}
