// `node in_three.mjs MODULES FILE.glb TIME [TIME …]`: plays a GLB file with three.js from the folder
// MODULES, and prints as JSON the world positions of all vertices at each time, in seconds.
import fs from "node:fs";
import path from "node:path";
import { pathToFileURL } from "node:url";

globalThis.self = globalThis;
const [modules, file, ...times] = process.argv.slice(2);
const load = (name) => import(pathToFileURL(path.join(modules, "three", name)).href);
const THREE = await load("build/three.module.js");
const { GLTFLoader } = await load("examples/jsm/loaders/GLTFLoader.js");

const data = fs.readFileSync(file);
const buffer = data.buffer.slice(data.byteOffset, data.byteOffset + data.byteLength);
const gltf = await new GLTFLoader().parseAsync(buffer, "");
const mixer = new THREE.AnimationMixer(gltf.scene);
for (const clip of gltf.animations) {
  const action = mixer.clipAction(clip);
  action.setLoop(THREE.LoopOnce);
  action.clampWhenFinished = true;
  action.play();
}
const found = times.map((time) => {
  mixer.setTime(Number(time));
  gltf.scene.updateMatrixWorld(true);
  const points = [];
  gltf.scene.traverse((node) => {
    if (!node.isMesh) return;
    if (node.skeleton) node.skeleton.update();
    const point = new THREE.Vector3();
    for (let i = 0; i < node.geometry.attributes.position.count; i++) {
      node.getVertexPosition(i, point).applyMatrix4(node.matrixWorld);
      points.push(point.toArray());
    }
  });
  return points;
});
console.log(JSON.stringify(found));
