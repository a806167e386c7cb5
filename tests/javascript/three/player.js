/**
 * Plays the animation of a .glb file in three.js, or of a .vrma file on a .vrm, and prints where each node is.
 *
 *     node player.js TIMES FILE.glb
 *     node player.js TIMES FILE.vrm FILE.vrma
 *
 * TIMES is a JSON list of seconds. The answer is JSON: world matrices (column by column) of all nodes by the
 * number of the node in the file, weights of all meshes with blendshapes, and triangles, for each time.
 */

import { readFile } from "node:fs/promises";

// What a browser has, for textures, whose pixels do not matter here.
globalThis.self ??= globalThis;
globalThis.createImageBitmap ??= async () => ({ width: 1, height: 1, close() {} });

const { AnimationMixer, LoopOnce } = await import("three");
const { GLTFLoader } = await import("three/examples/jsm/loaders/GLTFLoader.js");

/** @type {(path: string, plugins?: any[]) => Promise<any>} */
async function loaded(path, plugins = []) {
  const loader = new GLTFLoader();
  for (const plugin of plugins) loader.register(plugin);
  const { buffer, byteOffset, byteLength } = await readFile(path);
  return loader.parseAsync(buffer.slice(byteOffset, byteOffset + byteLength), "");
}

const [times, path, animation] = process.argv.slice(2);
let update = () => {};
let clip, file;
if (animation) {
  const { VRMLoaderPlugin } = await import("@pixiv/three-vrm");
  const { VRMAnimationLoaderPlugin, createVRMAnimationClip } = await import("@pixiv/three-vrm-animation");
  file = await loaded(path, [(parser) => new VRMLoaderPlugin(parser)]);
  const { vrm } = file.userData;
  const { vrmAnimations } = (await loaded(animation, [(parser) => new VRMAnimationLoaderPlugin(parser)])).userData;
  clip = createVRMAnimationClip(vrmAnimations[0], vrm);
  update = () => vrm.update(0);
} else {
  file = await loaded(path);
  [clip] = file.animations;
}
const mixer = new AnimationMixer(file.scene);
const action = mixer.clipAction(clip).setLoop(LoopOnce, 1);
action.clampWhenFinished = true;
action.play();
const moments = JSON.parse(times).map((time) => {
  mixer.setTime(time);
  update();
  file.scene.updateMatrixWorld(true);
  const [matrices, weights] = [{}, []];
  file.scene.traverse((object) => {
    const at = file.parser.associations.get(object);
    if (at?.nodes !== undefined && at.primitives === undefined) matrices[at.nodes] = object.matrixWorld.toArray();
    if (object.morphTargetInfluences) weights.push([...object.morphTargetInfluences]);
  });
  return { matrices, weights };
});
process.stdout.write(JSON.stringify({ duration: clip.duration, moments }));
