// The viewer page in Chromium.

import assert from 'node:assert/strict';
import { after, afterEach, before, describe, test } from 'node:test';
import { launch, mounts, newPage } from './browser.js';
import { serve } from './server.js';
import { checkStrips } from './strips.js';

const skip = !process.env.LODPACK_REFERENCE && 'cargo test -p lodpack-cli runs it';
const SCAN = '/files/valid-scan.lodpack';
const PAINTED = '/files/valid-painted.lodpack';
const DRAWN = '/files/valid-drawn.lodpack';
const LIT = '/files/valid-lit.lodpack';
const TOWN = '/files/valid-town.lodpack';
const GLOBE = '/files/heights-globe.lodpack';

describe('the viewer page', { skip }, () => {
  let browser;
  let server;
  let page;
  let fault;
  const errors = [];

  before(async () => {
    browser = await launch();
  });
  after(() => browser.close());
  afterEach(async () => {
    fault = undefined;
    await page?.close();
    await server?.close();
    assert.deepEqual(errors.splice(0), []);
  });

  /** Opens the page at an address, from a server of its own. */
  async function visit(address, options = {}) {
    server = await serve(mounts, { fault: (request) => fault?.(request), ...options });
    page = await newPage(browser, errors);
    await page.goto(server.url + address);
  }
  const isComplete = () => page.waitForFunction(() => globalThis.lodpackViewer?.last?.isComplete);
  const complaint = async () => {
    await page.waitForSelector('#error:not([hidden])');
    return page.textContent('#error');
  };
  const requests = () => server.log.filter(({ path }) => path.endsWith('.lodpack'));
  /** How many pixels of the canvas show the surface. */
  const covered = () => page.evaluate(() => {
    const { renderer, shown, camera } = globalThis.lodpackViewer;
    const { gl, canvas } = renderer;
    renderer.draw(shown.surfaces.map((surface) => surface.drawn(camera)), { colour: 'shading', tolerance: 1, wireframe: false });
    const pixels = new Uint8Array(4 * canvas.width * canvas.height);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    let count = 0;
    for (let k = 0; k < pixels.length; k += 4) count += Math.abs(pixels[k] - 232) + Math.abs(pixels[k + 2] - 244) > 6 ? 1 : 0;
    return count;
  });

  test('opens by address, refines without cracks, and says what it costs', async () => {
    await visit(`/?url=${SCAN}`);
    await isComplete();
    assert.ok(requests().length <= 4, JSON.stringify(requests()));
    assert.ok(await covered() > 5000);
    await page.waitForFunction(() => /complete/.test(document.getElementById('hud').textContent));
    assert.match(await page.textContent('#hud'), /triangles[^]*roots[^]*kB[^]*requests/);
    const { drawn, expected } = await page.evaluate(async () => {
      const { edgesOf, edgesOfMesh, nodesOf } = await import('/lodpack/test/picture.js');
      const { file, stream, pool } = globalThis.lodpackViewer.shown;
      return { drawn: edgesOf(pool), expected: edgesOfMesh(await file.extract({ nodes: nodesOf(pool) }), stream.origin) };
    });
    assert.deepEqual(drawn, expected);
  });

  test('a closer look loads more, and every frame on the way has no cracks', async () => {
    await visit(`/?url=${SCAN}#px=8`);
    await isComplete();
    const before = await page.evaluate(() => globalThis.lodpackViewer.shown.pool.triangleCount);
    const checks = await page.evaluate(async () => {
      const { edgesOf, edgesOfMesh, nodesOf } = await import('/lodpack/test/picture.js');
      const { camera, shown: { file, stream, pool } } = globalThis.lodpackViewer;
      const results = [];
      const update = pool.update.bind(pool);
      pool.update = (frame) => {
        update(frame);
        if (frame.uploads.length > 0) results.push([edgesOf(pool), nodesOf(pool)]);
      };
      for (let k = 0; k < 12; k += 1) {
        camera.zoom(0.8);
        camera.orbit(0.2, 0.05);
        document.getElementById('tolerance').value = 3 - k / 3;
        document.getElementById('tolerance').dispatchEvent(new Event('input'));
        await new Promise((resolve) => setTimeout(resolve, 150));
      }
      const checked = [];
      for (const [drawn, nodes] of results) checked.push([drawn, edgesOfMesh(await file.extract({ nodes }), stream.origin)]);
      return checked;
    });
    assert.ok(checks.length > 0, 'no frame changed anything');
    for (const [drawn, expected] of checks) assert.deepEqual(drawn, expected);
    await isComplete();
    assert.notEqual(await page.evaluate(() => globalThis.lodpackViewer.shown.pool.triangleCount), before);
  });

  test('a globe of heights is closed, refines without cracks, and lies as its north says', async () => {
    await visit(`/?url=${GLOBE}`);
    await isComplete();
    assert.ok(requests().length <= 8, JSON.stringify(requests()));
    assert.ok(await covered() > 5000);
    const results = await page.evaluate(async () => {
      const { edgesOf } = await import('/lodpack/test/picture.js');
      const { camera, shown: { file, pool } } = globalThis.lodpackViewer;
      const results = [];
      const update = pool.update.bind(pool);
      pool.update = (frame) => {
        update(frame);
        if (frame.uploads.length > 0) results.push(edgesOf(pool));
      };
      for (let k = 0; k < 12; k += 1) {
        camera.zoom(0.85);
        camera.orbit(0.3, 0.05);
        document.getElementById('tolerance').value = 2 - k / 3;
        document.getElementById('tolerance').dispatchEvent(new Event('input'));
        await new Promise((resolve) => setTimeout(resolve, 150));
      }
      return { results, kind: file.kind, up: camera.up };
    });
    assert.deepEqual([results.kind, results.up], ['heights', [0, 0, 1]]);
    assert.ok(results.results.length > 1, JSON.stringify(results));
    for (const { wrong, degenerate } of results.results) assert.deepEqual([wrong, degenerate], [0, 0]);
    await isComplete();
  });

  test('a mesh and its ground are one picture with one depth buffer, and both are picked and counted', async () => {
    await visit(`/?url=${TOWN}`);
    await isComplete();
    await page.waitForFunction(() => globalThis.lodpackViewer.shown.surfaces[1]?.stream.channel?.name === 'colour');
    await isComplete();
    await page.waitForTimeout(300);
    const seen = await page.evaluate(async () => {
      const { renderer, shown: { surfaces }, camera, pick } = globalThis.lodpackViewer;
      const { gl, canvas, draw } = renderer;
      const read = () => {
        const pixels = new Uint8Array(4 * canvas.width * canvas.height);
        gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
        return pixels;
      };
      const pixelsOf = (drawn) => {
        renderer.draw(drawn, { colour: 'shading', tolerance: 1, wireframe: false });
        return read();
      };
      // What the page itself draws.
      const both = await new Promise((resolve) => {
        renderer.draw = (...all) => {
          delete renderer.draw;
          draw.apply(renderer, all);
          resolve(read());
        };
        document.getElementById('tolerance').dispatchEvent(new Event('input'));
      });
      const drawn = surfaces.map((surface) => surface.drawn(camera));
      const alone = drawn.map((one) => pixelsOf([one]));
      const counts = { shown: [0, 0], hides: [0, 0], wrong: 0, upwards: 0, middle: [] };
      for (let y = 1; y < canvas.height; y += 4) {
        for (let x = 1; x < canvas.width; x += 4) {
          const place = [(2 * x + 1) / canvas.width - 1, (2 * y + 1) / canvas.height - 1];
          const hit = pick(...place);
          if (!hit) continue;
          const which = surfaces.indexOf(hit.surface);
          counts.shown[which] += 1;
          // Where neither the panel nor the numbers are.
          if (place.every((at) => Math.abs(at) < 0.4)) counts.middle[which] ??= [x, canvas.height - y];
          const ray = camera.ray(...place, canvas.clientWidth / canvas.clientHeight);
          if (surfaces[1 - which].pick(camera.position, ray)) counts.hides[which] += 1;
          const at = 4 * (y * canvas.width + x);
          if ([0, 1, 2].some((k) => Math.abs(both[at + k] - alone[which][at + k]) > 3)) counts.wrong += 1;
          // The ground is from 37 to 50 m high, the town's origin is 40 m, and its unit is a foot.
          const { point } = hit.surface.place(hit);
          if (which === 1) counts.upwards += point[1] > -4 / 0.3048 && point[1] < 11 / 0.3048 ? 1 : 0;
        }
      }
      const channels = [...document.querySelectorAll('#channel option')].map(({ textContent }) => textContent);
      const triangles = surfaces.map(({ pool }) => pool.triangleCount);
      const colours = new Set(Array.from({ length: alone[1].length / 4 }, (_, k) => alone[1].slice(4 * k, 4 * k + 3).join())).size;
      return { ...counts, up: camera.up, channels, triangles, colours, hud: document.getElementById('hud').textContent.replaceAll(/(\d) (?=\d)/g, '$1') };
    });
    const text = JSON.stringify(seen);
    assert.ok(seen.shown.every((count) => count > 200) && seen.hides.every((count) => count > 20), text);
    // Pixels on edges are of both.
    assert.ok(seen.wrong < 0.06 * (seen.shown[0] + seen.shown[1]), text);
    assert.equal(seen.upwards, seen.shown[1], text);
    assert.deepEqual([seen.up, seen.channels], [[0, 1, 0], ['colour', 'none']]);
    assert.ok(seen.triangles.every((count) => count > 50) && seen.colours > 100, text);
    assert.ok(seen.hud.includes(`${seen.triangles[0] + seen.triangles[1]} triangles`), text);
    // A point of each is measured, and a closer look loads more of the ground.
    await page.keyboard.press('m');
    for (const place of seen.middle) await page.mouse.click(...place);
    await page.waitForSelector('#marks text');
    assert.match(await page.textContent('#marks text'), /^\d+(\.\d+)? ± \d+(\.\d+)?$/);
    const before = seen.triangles[1];
    await page.evaluate(() => { globalThis.lodpackViewer.camera.zoom(0.3); document.getElementById('tolerance').value = -2; document.getElementById('tolerance').dispatchEvent(new Event('input')); });
    await page.waitForFunction((before) => globalThis.lodpackViewer.last.isComplete && globalThis.lodpackViewer.shown.surfaces[1].pool.triangleCount !== before, before);
    // What is closed gives both back.
    await page.goto(`${server.url}/?url=${SCAN}`);
    await isComplete();
    assert.equal(await page.evaluate(() => globalThis.lodpackViewer.shown.surfaces.length), 1);
  });

  test('a ground that is damaged is named', async () => {
    await visit('/?url=/vectors/invalid/ground_on_a_globe.lodpack');
    assert.match(await complaint(), /lies on a globe/);
    await page.goto(`${server.url}/?url=/vectors/invalid/ground_of_a_mesh.lodpack`);
    assert.match(await complaint(), /no file of heights/);
  });

  test('opens a file that is dropped', async () => {
    await visit('/');
    assert.match(await page.textContent('#hint'), /Drop a/);
    await page.evaluate(async (url) => {
      const bytes = await (await fetch(url)).arrayBuffer();
      const data = new DataTransfer();
      data.items.add(new File([bytes], 'dropped.lodpack'));
      globalThis.dispatchEvent(new DragEvent('drop', { dataTransfer: data, cancelable: true }));
    }, SCAN);
    await isComplete();
    assert.ok(await covered() > 5000);
    assert.match(await page.title(), /dropped\.lodpack/);
  });

  test('survives a server that fails now and then', async () => {
    fault = ({ path, count }) => (path.endsWith('.lodpack') && count % 2 ? (count % 4 === 1 ? 503 : 'cut') : undefined);
    await visit(`/?url=${SCAN}`);
    await isComplete();
    assert.ok(await covered() > 5000);
  });

  test('says what is wrong in words, and tries again when it is told to', async () => {
    await visit('/?url=/files/no-such.lodpack');
    assert.match(await complaint(), /no-such\.lodpack cannot be opened[^]*status 404: the file does not exist; check the address/);
    fault = ({ path }) => (path.endsWith('.lodpack') ? 404 : undefined);
    await page.goto(`${server.url}/?url=${SCAN}`);
    await complaint();
    fault = undefined;
    await page.click('#error button:first-of-type');
    await isComplete();
    assert.ok(await page.isHidden('#error'));
  });

  test('files that cannot be shown', async () => {
    await visit('/');
    const cases = [
      ['/vectors/invalid/newer_version.lodpack', /needs a newer lodpack/],
      ['/vectors/invalid/header_checksum.lodpack', /damaged file/],
      ['/vectors/invalid/empty.lodpack', /truncated|not a lodpack file|damaged/],
      ['/vectors/nothing.lodpack', /its surface is empty/],
      ['/index.html', /web page|not a lodpack file/],
      ['http://127.0.0.1:9/x.lodpack', /cannot be reached/],
    ];
    for (const [address, message] of cases) {
      await page.goto(`${server.url}/?url=${encodeURIComponent(address)}`);
      assert.match(await complaint(), message, address);
    }
  });

  test('servers on other hosts: with and without CORS, and with hidden headers', async () => {
    await visit('/');
    for (const [options, message] of [[{ cors: false }, /does not allow this page to read it \(CORS\)/], [{ expose: false }], [{}]]) {
      const other = await serve(mounts, options);
      await page.goto(`${server.url}/?url=${other.url}${SCAN}`);
      if (message) assert.match(await complaint(), message);
      else await isComplete();
      await other.close();
    }
  });

  test('servers without ranges and with compression', async () => {
    fault = ({ path }) => (path.endsWith('.lodpack') ? 'whole' : undefined);
    await visit(`/?url=${SCAN}`);
    await isComplete();
    // Browsers ask for ranges without compression, and Chromium refuses answers that have it all the same.
    for (const wrong of ['gzip-whole', 'gzip']) {
      fault = ({ path }) => (path.endsWith('.lodpack') ? wrong : undefined);
      await page.goto(`${server.url}/?url=${SCAN}&${wrong}`);
      assert.match(await complaint(), /compress/);
    }
  });

  test('a file that changes on the server', async () => {
    // It changes after the first request.
    fault = ({ path, range }) => {
      if (path.endsWith('.lodpack') && !range.startsWith('bytes=0-')) server.change();
    };
    await visit(`/?url=${SCAN}`);
    assert.match(await complaint(), /the file changed while it was read.*open it again/);
    await page.click('#error button:first-of-type');
    await isComplete();
    assert.ok(await page.isHidden('#error'));
  });

  test('the camera is in the address, and nonsense there is ignored', async () => {
    await visit(`/?url=${SCAN}`);
    await isComplete();
    const place = () => page.evaluate(() => globalThis.lodpackViewer.camera.toString());
    const first = await place();
    const drag = async (button = 'left') => {
      await page.mouse.move(300, 200);
      await page.mouse.down({ button });
      await page.mouse.move(340, 220, { steps: 4 });
      await page.mouse.up({ button });
    };
    const seen = new Set([first]);
    await drag();
    seen.add(await place());
    await drag('right');
    seen.add(await place());
    await page.mouse.wheel(0, -200);
    await page.waitForTimeout(100);
    seen.add(await place());
    await page.keyboard.press('f');
    await drag();
    seen.add(await place());
    const before = await place();
    await page.keyboard.down('w');
    await page.waitForFunction((camera) => globalThis.lodpackViewer.camera.toString() !== camera, before);
    await page.keyboard.up('w');
    seen.add(await place());
    assert.equal(seen.size, 6, 'orbit, pan, zoom, look and fly each move the camera');
    const last = await place();
    await page.waitForFunction((camera) => location.hash.includes(camera), last);
    await page.reload();
    await isComplete();
    assert.equal(await place(), last);
    await page.goto(`${server.url}/?url=${SCAN}&b#camera=NaN,0,0:0,0,0&px=-3&colour=plaid`);
    await isComplete();
    assert.equal(await place(), first);
  });

  test('the package works from another host, and says so where workers are forbidden', async () => {
    await visit('/');
    const html = (head) => new TextEncoder().encode(`<!doctype html>${head}<script type="module">
      import { open } from '${server.url}/lodpack/js/index.js';
      const read = async () => {
        const file = await open('${server.url}${SCAN}');
        return (await file.extract(await file.select({}))).triangles.length / 3;
      };
      read().catch((error) => error.message).then((result) => { globalThis.result = result; });
    </script>`);
    const policy = `<meta http-equiv="Content-Security-Policy" content="worker-src 'none'">`;
    const site = await serve({ '/plain.html': html(''), '/strict.html': html(policy) });
    const result = async (name) => {
      await page.goto(`${site.url}/${name}.html`);
      return (await page.waitForFunction(() => globalThis.result)).jsonValue();
    };
    assert.ok(await result('plain') > 1000);
    assert.match(await result('strict'), /the page may forbid workers/);
    await site.close();
  });

  test('an image over heights is drawn', async () => {
    const colours = async (address) => {
      await visit(`/?url=${address}`);
      await isComplete();
      const count = await page.evaluate(() => {
        const { renderer, shown, camera } = globalThis.lodpackViewer;
        const { gl, canvas } = renderer;
        renderer.draw(shown.surfaces.map((surface) => surface.drawn(camera)), { colour: 'colours', tolerance: 1, wireframe: false });
        const pixels = new Uint8Array(4 * canvas.width * canvas.height);
        gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
        const seen = new Set();
        for (let k = 0; k < pixels.length; k += 4) seen.add(pixels.subarray(k, k + 3).map((value) => value >> 5).join());
        return seen.size;
      });
      await page.close();
      await server.close();
      return count;
    };
    const [plain, draped] = [await colours('/vectors/heights/hills.lodpack'), await colours('/vectors/heights/draped.lodpack')];
    assert.ok(draped > 2 * plain && draped > 40, `${draped} and ${plain} colours`);
  });

  test('two fingers pinch', async () => {
    await visit(`/?url=${SCAN}`);
    await isComplete();
    const distance = () => page.evaluate(() => {
      const { camera: { position, target } } = globalThis.lodpackViewer;
      return Math.hypot(...position.map((x, k) => x - target[k]));
    });
    const before = await distance();
    const session = await page.context().newCDPSession(page);
    const touch = (type, ...points) => session.send('Input.dispatchTouchEvent', { type, touchPoints: points.map(([x, y], id) => ({ x, y, id })) });
    await touch('touchStart', [200, 180], [280, 180]);
    for (let k = 0; k <= 4; k += 1) await touch('touchMove', [200 - 10 * k, 180], [280 + 10 * k, 180]);
    await touch('touchEnd');
    assert.ok(await distance() < before * 0.7);
  });

  test('a distance is measured with its bound', async () => {
    await visit(`/?url=${SCAN}`);
    await isComplete();
    await page.keyboard.press('m');
    await page.mouse.click(240, 150);
    await page.mouse.click(240, 210);
    await page.waitForSelector('#marks text');
    assert.match(await page.textContent('#marks text'), /^\d+(\.\d+)? ± \d+(\.\d+)?$/);
    const { result, ends, finest } = await page.evaluate(() => {
      const { measure, pick, shown } = globalThis.lodpackViewer;
      const hit = pick(0, 0.1);
      return { result: measure.result, ends: hit.entry.error, finest: shown.file.levels.at(-1).maxError };
    });
    assert.ok(result.distance > 0 && result.uncertainty > 0 && result.uncertainty <= 10 * Math.max(finest, ends));
  });

  test('colours and edges change the picture', async () => {
    await visit(`/?url=${SCAN}#colour=level&wire=1`);
    await isComplete();
    assert.equal(await page.inputValue('#colour'), 'level');
    const shots = new Set();
    for (const [colour, wire] of [['shading', false], ['level', false], ['error', false], ['error', true]]) {
      await page.evaluate(([value, isOn]) => {
        document.getElementById('panel').open = true;
        document.getElementById('colour').value = value;
        document.getElementById('wireframe').checked = isOn;
        document.getElementById('wireframe').dispatchEvent(new Event('input'));
      }, [colour, wire]);
      await page.waitForTimeout(300);
      shots.add((await page.screenshot({ clip: { x: 220, y: 60, width: 120, height: 200 } })).toString('base64'));
    }
    assert.equal(shots.size, 4);
  });

  /**
   * How far the picture is from the colours that the input has there, of 255: root mean square, and the share of pixels
   * that are far off.
   */
  const paintErrors = () => page.evaluate(async () => {
    const { paintedColour, pixelsOf } = await import('/lodpack/test/picture.js');
    const { renderer, pick, shown, camera } = globalThis.lodpackViewer;
    const { canvas } = renderer;
    const pixels = pixelsOf(globalThis.lodpackViewer, 'colours', true);
    let [sum, far, count] = [0, 0, 0];
    for (let y = 2; y < canvas.height; y += 5) {
      for (let x = 2; x < canvas.width; x += 5) {
        const hit = pick((2 * x + 1) / canvas.width - 1, (2 * y + 1) / canvas.height - 1);
        if (!hit) continue;
        const point = hit.point.map((value, axis) => value + shown.stream.origin[axis]);
        const errors = paintedColour(point).map((value, k) => value - pixels[4 * (y * canvas.width + x) + k]);
        sum += errors.reduce((all, error) => all + error * error, 0) / 3;
        far += errors.some((error) => Math.abs(error) > 40) ? 1 : 0;
        count += 1;
      }
    }
    return { error: Math.sqrt(sum / count), far: far / count, count };
  });

  test('masks are cut out at their cutoff, blended surfaces are scattered, and unlit ones take no light', async () => {
    await visit(`/?url=${DRAWN}#camera=3,0.5,6:3,0.5,0:0,1,0`);
    await isComplete();
    const strips = await page.evaluate(async () => {
      const { pixelsOf, stripsOf } = await import('/lodpack/test/picture.js');
      const { renderer, pick, shown, camera } = globalThis.lodpackViewer;
      const { canvas } = renderer;
      const pixels = pixelsOf(globalThis.lodpackViewer, 'colours', false);
      const place = (x, y) => {
        const hit = pick((2 * x + 1) / canvas.width - 1, (2 * y + 1) / canvas.height - 1);
        return hit && hit.point[0] + shown.stream.origin[0];
      };
      return stripsOf(pixels, canvas, place);
    });
    checkStrips(strips);
  });

  /** How far the light of the picture is from that of the input's normals: root mean square of its shades, of 255. */
  const lightError = () => page.evaluate(async () => {
    const { outwardsOfTorus, pixelsOf } = await import('/lodpack/test/picture.js');
    const { renderer, pick, shown, camera } = globalThis.lodpackViewer;
    const { canvas } = renderer;
    // Directions that are lit have no colours: the surface is of one colour.
    const pixels = pixelsOf(globalThis.lodpackViewer, 'directions', false);
    const dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
    const unit = (a) => a.map((x) => x / Math.hypot(...a));
    const [right, up, forward] = camera.axes;
    let [sum, count] = [0, 0];
    for (let y = 2; y < canvas.height; y += 5) {
      for (let x = 2; x < canvas.width; x += 5) {
        const hit = pick((2 * x + 1) / canvas.width - 1, (2 * y + 1) / canvas.height - 1);
        if (!hit) continue;
        const outwards = outwardsOfTorus(hit.point.map((value, axis) => value + shown.stream.origin[axis]));
        const normal = [right, up, forward].map((axis) => dot(axis, outwards));
        const [key, fill] = [[-0.45, 0.6, -0.66], [0.8, 0, -0.6]].map((light) => Math.max(dot(normal, unit(light)), 0));
        const light = 0.16 + 0.92 * key + 0.18 * fill + 0.08 * normal[1];
        const wanted = 255 * Math.sqrt(Math.min(Math.max(0.86 * 0.86 * light, 0), 1));
        sum += (wanted - pixels[4 * (y * canvas.width + x)]) ** 2;
        count += 1;
      }
    }
    return { error: Math.sqrt(sum / count), count };
  });

  test('few triangles are lit with the normals of the file', async () => {
    const errors = {};
    for (const [name, hash] of [['coarse', '#px=12'], ['directions', '#px=12&channel=normal'], ['fine', ''], ['flat', '#px=12&channel=none']]) {
      await visit(`/?url=${LIT}${hash}`);
      await isComplete();
      await page.waitForFunction(() => /complete/.test(document.getElementById('hud').textContent));
      errors[name] = await lightError();
      assert.ok(errors[name].count > 500, JSON.stringify(errors));
      if (name === 'flat') continue;
      await page.close();
      await server.close();
    }
    assert.ok(errors.fine.error < 6 && errors.coarse.error < errors.flat.error / 2, JSON.stringify(errors));
    assert.deepEqual(errors.directions, errors.coarse);
  });

  test('colours are those of the input, and the device that is lost gets them again', async () => {
    await visit(`/?url=${PAINTED}`);
    await isComplete();
    const before = await paintErrors();
    assert.ok(before.count > 500 && before.error < 10 && before.far < 0.01, JSON.stringify(before));
    await page.evaluate(() => { globalThis.lost = globalThis.lodpackViewer.renderer.gl.getExtension('WEBGL_lose_context'); globalThis.lost.loseContext(); });
    await page.waitForFunction(() => globalThis.lodpackViewer.renderer.isLost);
    await page.waitForTimeout(100);
    await page.evaluate(() => globalThis.lost.restoreContext());
    await page.waitForFunction(() => !globalThis.lodpackViewer.renderer.isLost);
    assert.deepEqual(await paintErrors(), before);
  });

  test('closer looks bring finer images, and textures do not grow without end', async () => {
    await visit(`/?url=${PAINTED}#px=16`);
    await isComplete();
    const texels = () => page.evaluate(() => globalThis.lodpackViewer.shown.pool.texels);
    /** The finest level of a root that is drawn with its image. */
    const finest = () => page.evaluate(() => {
      const entries = [...globalThis.lodpackViewer.shown.pool.roots.values()];
      return Math.max(...entries.filter(({ tile }) => tile.width > 1).map(({ level }) => level));
    });
    const first = await finest();
    for (let k = 0; k < 6; k += 1) {
      await page.evaluate(() => { globalThis.lodpackViewer.camera.zoom(0.75); globalThis.lodpackViewer.camera.orbit(0.6, 0.1); });
      await page.evaluate(() => document.getElementById('tolerance').dispatchEvent(new Event('input')));
      await page.waitForTimeout(200);
      await isComplete();
    }
    const near = await finest();
    assert.ok(near > first, `level ${first}, then ${near}`);
    await page.keyboard.press('h');
    await page.waitForTimeout(300);
    await isComplete();
    await page.waitForTimeout(300);
    const [last, used] = [await texels(), await page.evaluate(() => {
      const tiles = [...globalThis.lodpackViewer.shown.pool.roots.values()].map(({ tile }) => tile);
      return tiles.reduce((sum, { width, height }) => sum + width * height, 0);
    })];
    assert.equal(last.used, used);
    assert.ok(last.allocated <= 8 << 20, JSON.stringify(last));
    const { error, far } = await paintErrors();
    assert.ok(error < 12 && far < 0.02, `${error}, ${far}`);
  });

  test('the channel is chosen in the panel and in the address, and without one no texel is fetched', async () => {
    await visit(`/?url=${PAINTED}#channel=none`);
    await isComplete();
    const bare = requests().length;
    assert.deepEqual(await page.$$eval('#channel option', (options) => options.map(({ textContent }) => textContent)), ['colour', 'height', 'none']);
    assert.equal(await page.evaluate(() => globalThis.lodpackViewer.last.counters.imageBytes), 0);
    assert.ok(await page.isHidden('#scale'));
    await page.evaluate(() => { document.getElementById('panel').open = true; });
    await page.selectOption('#channel', { label: 'height' });
    await page.waitForFunction(() => globalThis.lodpackViewer.shown.stream.channel?.name === 'height' && globalThis.lodpackViewer.last.counters.imageBytes > 0);
    await isComplete();
    assert.ok(requests().length > bare);
    assert.ok(await page.isVisible('#scale'));
    assert.ok(Number(await page.getAttribute('#low', 'placeholder')) < -8 && Number(await page.getAttribute('#high', 'placeholder')) > 8);
    await page.fill('#low', '0');
    await page.fill('#high', '5');
    await page.uncheck('#light');
    await page.waitForFunction(() => /channel=height&range=0:5&unlit=1/.test(location.hash));
    await page.reload();
    await isComplete();
    await page.waitForFunction(() => globalThis.lodpackViewer.shown.stream.range?.[1] === 5);
    assert.equal(await page.isChecked('#light'), false);
    // What makes no sense is left out.
    await page.goto(`${server.url}/?url=${PAINTED}&c#channel=plaid&range=5:0`);
    await isComplete();
    await page.waitForFunction(() => globalThis.lodpackViewer.shown.stream.channel?.name === 'colour');
    await page.goto(`${server.url}/?url=${SCAN}`);
    await isComplete();
    assert.ok(await page.isHidden('#channel-row'));
  });

  test('a device that is lost comes back', async () => {
    await visit(`/?url=${SCAN}`);
    await isComplete();
    const before = await covered();
    await page.evaluate(() => { globalThis.lost = globalThis.lodpackViewer.renderer.gl.getExtension('WEBGL_lose_context'); globalThis.lost.loseContext(); });
    await page.waitForFunction(() => globalThis.lodpackViewer.renderer.isLost);
    await page.waitForTimeout(100);
    await page.evaluate(() => globalThis.lost.restoreContext());
    await page.waitForFunction(() => !globalThis.lodpackViewer.renderer.isLost);
    assert.equal(await covered(), before);
  });

  test('a tab that closes while it loads ends its requests', async () => {
    fault = ({ path }) => (path.endsWith('.lodpack') ? 'hang' : undefined);
    await visit(`/?url=${SCAN}`);
    while (requests().length === 0) await page.waitForTimeout(50);
    assert.ok(server.connectionCount() > 0);
    await page.close();
    page = undefined;
    for (let k = 0; k < 100 && server.connectionCount() > 0; k += 1) await new Promise((resolve) => setTimeout(resolve, 50));
    assert.equal(server.connectionCount(), 0);
  });
});
