// Picks objects of a folder of 3D Tiles in CesiumJS in headless Chromium:
//
//     node cesium_picks.mjs TILES MODULES HIDDEN [PICTURE.png]
//
// MODULES is a node_modules with cesium and playwright-core. HIDDEN is a list of names, separated by commas, that a
// style hides. Prints JSON: for pixels all over the picture their rays in the tileset's coordinates and those up to a
// pixel beside them, and the name, id and path of what `scene.pick` returns there, or null.

import { createRequire } from 'node:module';
import { join, resolve } from 'node:path';
import { serve } from '../../reader/wasm/test/server.js';

const [tiles, modules, hidden, picture] = process.argv.slice(2);
const { chromium } = createRequire(resolve(modules, 'x.js'))('playwright-core');
const server = await serve({ '/cesium/': join(modules, 'cesium/Build/Cesium'), '/tiles/': tiles });
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
  args: ['--no-sandbox', '--disable-background-networking', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
});
const page = await browser.newPage({ viewport: { width: 640, height: 480 } });
const problems = [];
page.on('pageerror', (thrown) => problems.push(thrown.stack));
page.on('console', (message) => message.type() === 'error' && problems.push(message.text()));
await page.route('**/index.html', (route) => route.fulfill({
  contentType: 'text/html',
  body: `<!doctype html><link rel="icon" href="data:,"><style>body, #scene, canvas { margin: 0; width: 640px; height: 480px; }</style>
    <div id="scene"></div><script src="/cesium/Cesium.js"></script>`,
}));
await page.goto(`${server.url}/index.html`);
const found = await page.evaluate(async (names) => {
  const { Cesium } = globalThis;
  const nothing = { globe: false, skyBox: false, skyAtmosphere: false, baseLayer: false };
  const widget = new Cesium.CesiumWidget('scene', { ...nothing, useDefaultRenderLoop: false });
  const { scene } = widget;
  widget.resize();
  scene.backgroundColor = Cesium.Color.WHITE;
  const tileset = await Cesium.Cesium3DTileset.fromUrl('/tiles/tileset.json', { maximumScreenSpaceError: 0.2 });
  const place = Cesium.Transforms.eastNorthUpToFixedFrame(Cesium.Cartesian3.fromDegrees(9, 47, 0));
  tileset.modelMatrix = place;
  const shown = names.map((name) => `\${name} !== '${name}'`).join(' && ');
  if (names.length > 0) tileset.style = new Cesium.Cesium3DTileStyle({ show: shown });
  scene.primitives.add(tileset);
  scene.render();
  const { center, radius } = tileset.boundingSphere;
  scene.camera.lookAt(center, new Cesium.HeadingPitchRange(0.5, -0.5, 0.8 * radius));
  scene.camera.lookAtTransform(Cesium.Matrix4.IDENTITY);
  scene.light = new Cesium.DirectionalLight({ direction: scene.camera.direction });
  for (let calm = 0; calm < 5;) {
    scene.render();
    await new Promise((done) => setTimeout(done, 50));
    calm = tileset.tilesLoaded ? calm + 1 : 0;
  }
  const back = Cesium.Matrix4.inverseTransformation(place, new Cesium.Matrix4());
  // Pixels that show something, evenly, and a tenth as many of the others.
  scene.render();
  const copy = Object.assign(document.createElement('canvas'), { width: 640, height: 480 }).getContext('2d');
  copy.drawImage(scene.canvas, 0, 0);
  const { data } = copy.getImageData(0, 0, 640, 480);
  const pixels = [[], []];
  for (let at = 0; at < 640 * 480; at += 1) {
    const [x, y] = [at % 640, Math.floor(at / 640)];
    const isWhite = [0, 1, 2].every((k) => data[4 * at + k] === 255);
    if (x > 2 && y > 2 && x < 637 && y < 477) pixels[Number(isWhite)].push([x, y]);
  }
  const some = (list, count) => list.filter((_, k) => Math.floor((k * count) / list.length) !== Math.floor(((k + 1) * count) / list.length));
  const steps = [0, -1, -0.5, 0.5, 1];
  const around = steps.flatMap((right) => steps.map((down) => [right, down]));
  const picks = [];
  for (const [x, y] of [...some(pixels[0], 1000), ...some(pixels[1], 100)]) {
    // The pixel whose lower left corner is there.
    const at = new Cesium.Cartesian2(x, y);
    const rays = around.map(([right, down]) => {
      const ray = scene.camera.getPickRay(new Cesium.Cartesian2(x + 0.5 + right, y - 0.5 + down));
      const [origin, direction] = [
        Cesium.Matrix4.multiplyByPoint(back, ray.origin, new Cesium.Cartesian3()),
        Cesium.Matrix4.multiplyByPointAsVector(back, ray.direction, new Cesium.Cartesian3()),
      ];
      return [origin, direction].map(({ x: a, y: b, z: c }) => [a, b, c]);
    });
    const feature = scene.pick(at, 1, 1);
    const said = feature?.getProperty && ['name', 'id', 'path'].map((key) => feature.getProperty(key) ?? '');
    picks.push({ pixel: [x, y], rays, said: said ?? null });
  }
  scene.render();
  return { version: Cesium.VERSION, picks };
}, hidden.split(',').filter(Boolean));
if (picture) await page.screenshot({ path: picture });
console.log(JSON.stringify({ ...found, problems }));
await browser.close();
await server.close();
