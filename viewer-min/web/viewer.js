// The page: opens a file by its address or from the disk, streams it for a camera, and draws it.

import { EtagMismatch, SharedBudget, open } from 'lodpack';
import { Camera, VERTICAL_FOV } from './camera.js';
import { Controls } from './controls.js';
import { Measure } from './measure.js';
import { ObjectPanel } from './objects.js';
import { Renderer } from './renderer.js';
import { Surface, joinedFrames } from './surface.js';

const $ = (id) => document.getElementById(id);
const canvas = $('canvas');
const camera = new Camera();
const measure = new Measure($('marks'));
const objects = new ObjectPanel($('objects'), $('name'), { changed: () => ask(), fly: flyTo, failed: (error) => complain('The objects cannot be read', error.message) });
let renderer;
let shown = null; // The open file: { file, stream, pool, from, name, surfaces }; stream and pool are those of the first surface.
let opening = null; // Aborts what is being opened.
let isDirty = true; // Whether something has to be drawn.
let wantsFrame = true; // Whether the stream has to be asked.
let isAsking = false;
let last = null; // The last frame of all surfaces.
let budget = new SharedBudget();
let lastTolerance;
let times = { frame: 0, update: 0 };

/** Opens a file, in place of the one that is open. */
async function show(from, name) {
  opening?.abort();
  const controller = (opening = new AbortController());
  close();
  $('error').hidden = true;
  $('hint').hidden = false;
  $('hint').textContent = `Opening ${name} …`;
  try {
    const file = await open(from, { signal: controller.signal });
    const surfaces = await Surface.allOf(file, renderer, controller.signal).catch((error) => {
      file.close();
      throw error;
    });
    if (controller.signal.aborted) return surfaces.forEach((surface) => surface.close());
    const [{ stream, pool }, ground] = surfaces;
    shown = { file, stream, pool, from, name, surfaces };
    for (const { stream } of surfaces) stream.onprogress = ask;
    document.title = `${name} – lodpack`;
    $('hint').hidden = true;
    if (!bounds()) {
      complain('There is nothing to see', `${name} is a sound file, but its surface is empty.`);
    } else {
      // A mesh says which axis is up, or nothing. Heights go along z; where a mesh stands on them, in the space of the
      // mesh.
      if (file.up) $('up').value = file.up;
      if (file.kind === 'heights' || ground) $('up').value = ground?.file.frame.meshFromGround[6] ? 'y' : 'z';
      camera.showAll(bounds(), upAxis(), canvas.clientWidth / canvas.clientHeight);
      listChannels();
      applyAddress();
      objects.open(shown.surfaces[0]).catch((error) => complain('The objects cannot be read', error.message));
    }
    ask();
  } catch (error) {
    if (controller.signal.aborted) return;
    complain(`${name} cannot be opened`, error.message, () => show(from, name));
  }
}

function close() {
  if (!shown) return;
  objects.close();
  shown.surfaces.forEach((surface) => surface.close());
  shown = null;
  last = null;
  measure.clear();
  isDirty = true;
}

/** The box around everything, or null. */
function bounds() {
  const boxes = shown.surfaces.map((surface) => surface.bounds).filter(Boolean);
  const all = (name, of) => [0, 1, 2].map((axis) => of(...boxes.map((box) => box[name][axis])));
  return boxes.length > 0 ? { min: all('min', Math.min), max: all('max', Math.max) } : null;
}

/** Says what went wrong, in words for people. */
function complain(title, text, again) {
  const box = $('error');
  box.querySelector('h2').textContent = title;
  box.querySelector('p').textContent = text;
  const [retry, dismiss] = box.querySelectorAll('button');
  retry.hidden = !again;
  retry.onclick = () => {
    box.hidden = true;
    again();
  };
  dismiss.onclick = () => { box.hidden = true; };
  box.hidden = false;
  $('hint').hidden = true;
}

/** Something may look different now. */
function ask() {
  wantsFrame = true;
  isDirty = true;
}

function view() {
  const [width, height] = renderer.resize();
  const [, up, forward] = camera.axes;
  const pixelTolerance = 2 ** Number($('tolerance').value);
  return { position: camera.position, forward, up, viewport: [width, height], verticalFov: VERTICAL_FOV, near: camera.near, pixelTolerance };
}

/** Asks the streams what to draw: one question at a time. */
async function follow() {
  if (!shown || isAsking || !wantsFrame) return;
  isAsking = true;
  wantsFrame = false;
  const { stream, surfaces, file, name, from } = shown;
  try {
    const seen = view();
    const { marked } = objects;
    const asked = marked ? [...surfaces, marked] : surfaces;
    // What is selected may end meanwhile.
    const most = Number($('triangles').value);
    const limits = most > 0 ? budget.limits(most, seen.pixelTolerance, surfaces.length) : undefined;
    if (limits) seen.pixelTolerance = limits.pixelTolerance;
    const frames = await Promise.all(asked.map((surface, k) => surface.ask(seen, limits?.maxTriangles[k]).catch((error) => {
      if (surface !== marked) throw error;
      return null;
    })));
    if (shown?.stream !== stream) return;
    const begun = performance.now();
    asked.forEach(({ pool }, k) => frames[k] && pool.update(frames[k]));
    if (marked) {
      const ofMarked = frames.pop();
      if (ofMarked?.uploads.length + ofMarked?.drops.length > 0) isDirty = true;
    }
    times.update = performance.now() - begun;
    if (limits) budget.record(frames);
    // Triangles are shared out anew until all surfaces have about the same error.
    if (limits && limits.pixelTolerance !== lastTolerance) wantsFrame = true;
    lastTolerance = limits?.pixelTolerance;
    last = joinedFrames(frames);
    if (last.hasChanges) isDirty = true;
    if (last.problems.length > 0) {
      complain('Parts of the surface cannot be loaded', `${last.problems[0]}. What is loaded stays visible, coarser than wanted.`, () => {
        if (file.failure instanceof EtagMismatch) show(from, name);
        else Promise.all(surfaces.map(({ stream }) => stream.retry())).then(ask);
      });
    }
  } catch (error) {
    if (shown?.stream === stream) complain(`${name} cannot be shown`, error.message, () => show(from, name));
  } finally {
    isAsking = false;
  }
}

const channels = () => (shown?.surfaces ?? []).flatMap(({ file }) => file.channels).filter(({ kind }) => kind !== 'unknown');

/** Offers the channels of all surfaces: at first the first one of colours, or normals. */
function listChannels() {
  const names = [...new Set(channels().map(({ name }) => name))];
  $('channel').replaceChildren(...names.map((name) => new Option(name, `channel ${name}`)), new Option('none'));
  $('channel').value = firstChannel();
  $('channel-row').hidden = names.length === 0;
  [$('low').value, $('high').value, $('scale').hidden, $('light-row').hidden] = ['', '', true, true];
}

/** What is chosen while nobody chooses. */
function firstChannel() {
  const first = ['colour', 'normal'].map((wanted) => channels().find(({ kind }) => kind === wanted)).find(Boolean);
  return first ? `channel ${first.name}` : 'none';
}

const chosenChannel = () => ($('channel').value.startsWith('channel ') ? $('channel').value.slice(8) : 'none');

/** The values of the ends of the ramp that somebody has set, or undefined. */
function chosenRange() {
  const [low, high] = [$('low').value, $('high').value].map((text) => (text === '' ? NaN : Number(text)));
  return low < high ? [low, high] : undefined;
}

/** Shows the channel that is chosen, if another one is shown. */
async function showChannel() {
  const { stream, surfaces, name } = shown;
  const wanted = JSON.stringify([chosenChannel(), chosenRange()]);
  if (shown.channel === wanted || (!shown.channel && chosenChannel() === 'none')) return;
  shown.channel = wanted;
  try {
    await Promise.all(surfaces.map((surface) => surface.show(chosenChannel(), chosenRange())));
  } catch (error) {
    if (shown?.stream !== stream) return;
    shown.channel = undefined;
    complain(`A channel of ${name} cannot be shown`, error.message, showChannel);
    return;
  }
  if (shown?.stream !== stream || shown.channel !== wanted) return;
  const digits = (value) => String(Number(value.toPrecision(5)));
  const range = surfaces.map(({ stream }) => stream.range).find(Boolean);
  [$('low').placeholder, $('high').placeholder] = range?.map(digits) ?? ['', ''];
  $('scale').hidden = !range;
  $('light-row').hidden = !surfaces.some(({ stream }) => stream.channel);
  ask();
}

function statistics() {
  if (!shown) return '';
  const { file, surfaces } = shown;
  const sum = (of) => surfaces.reduce((all, { pool }) => all + of(pool), 0);
  const { requests, bytes } = file.traffic;
  const number = (value) => Math.round(value).toLocaleString('en').replaceAll(',', ' ');
  const lines = [`${number(sum(({ triangleCount }) => triangleCount))} triangles`, `${number(sum(({ roots }) => roots.size))} roots`];
  lines.push(`${number(bytes / 1000)} of ${number(file.byteLength / 1000)} kB`, `${requests} requests`);
  if (last) {
    lines.push(last.shows === 'picture' ? `${last.errorPx.toFixed(2)} px error` : last.shows);
    lines.push(last.isComplete ? 'complete' : `${last.lateRoots} roots coarser`);
    if (last.lateImages > 0) lines.push(`${last.lateImages} roots without image`);
  }
  if (surfaces.some(({ pool }) => pool.images)) {
    lines.push(`${number(sum(({ texels }) => texels.used) / 1000)} of ${number(sum(({ texels }) => texels.allocated) / 1000)} k texels`);
  }
  lines.push(`${times.frame.toFixed(1)} ms a frame`);
  return lines.join('\n');
}

let before = performance.now();
function frame(now) {
  requestAnimationFrame(frame);
  const begun = performance.now();
  if (controls.step((now - before) / 1000)) moved();
  before = now;
  follow();
  if (!isDirty || renderer.isLost) return;
  isDirty = false;
  const drawn = shown ? [...shown.surfaces, objects.marked].filter(Boolean) : [];
  renderer.draw(drawn.map((surface) => surface.drawn(camera)), {
    colour: $('colour').value, tolerance: 2 ** Number($('tolerance').value), wireframe: $('wireframe').checked, isUnlit: !$('light').checked,
  });
  measure.draw(camera, [canvas.clientWidth, canvas.clientHeight], VERTICAL_FOV);
  times.frame = performance.now() - begun;
  $('hud').textContent = statistics();
}

let remembering;
function moved() {
  ask();
  clearTimeout(remembering);
  // Browsers forbid more than a few changes of the address a second.
  remembering = setTimeout(() => history.replaceState(null, '', address()), 300);
}

/** This page's address with camera and settings. */
function address() {
  const url = new URL(location.href);
  const settings = new URLSearchParams();
  if (shown) settings.set('camera', camera.toString());
  if ($('colour').value !== 'shading') settings.set('colour', $('colour').value);
  if ($('tolerance').value !== '0') settings.set('px', String(2 ** Number($('tolerance').value)));
  if ($('triangles').value) settings.set('triangles', $('triangles').value);
  if ($('wireframe').checked) settings.set('wire', '1');
  if (!$('channel-row').hidden && $('channel').selectedIndex >= 0) {
    if ($('channel').value !== firstChannel()) settings.set('channel', chosenChannel());
    if (chosenRange() && !$('scale').hidden) settings.set('range', chosenRange().join(':'));
    if (!$('light').checked) settings.set('unlit', '1');
  }
  url.hash = settings.toString().replaceAll('%2C', ',').replaceAll('%3A', ':');
  return url.href;
}

/** Takes camera and settings from the address. What makes no sense is left out. */
function applyAddress() {
  const settings = new URLSearchParams(location.hash.slice(1));
  if (settings.has('camera')) camera.parse(settings.get('camera'));
  if ([...$('colour').options].some(({ value }) => value === settings.get('colour'))) $('colour').value = settings.get('colour');
  const pixels = Number(settings.get('px'));
  if (pixels > 0 && Number.isFinite(pixels)) $('tolerance').value = Math.log2(pixels);
  const most = Math.floor(Number(settings.get('triangles')));
  $('triangles').value = most > 0 && Number.isFinite(most) ? most : '';
  $('wireframe').checked = settings.get('wire') === '1';
  const options = [...$('channel').options].map(({ value }) => value);
  const channel = settings.get('channel');
  const option = [channel === 'none' ? 'none' : `channel ${channel}`].find((value) => options.includes(value));
  if (options.length > 0) $('channel').value = option ?? firstChannel();
  const range = settings.get('range')?.split(':').map(Number) ?? [];
  [$('low').value, $('high').value] = range.length === 2 && range[0] < range[1] ? range : ['', ''];
  $('light').checked = settings.get('unlit') !== '1';
  $('up').value = Math.abs(camera.up[2]) > 0.9 ? 'z' : 'y';
  settingsChanged();
}

function settingsChanged() {
  if (shown) showChannel();
  $('pixels').textContent = `${Number((2 ** Number($('tolerance').value)).toPrecision(2))} px`;
  ask();
}

/** What a place in the picture shows, or null. */
function pick(x, y) {
  if (!shown) return null;
  const ray = camera.ray(x, y, canvas.clientWidth / canvas.clientHeight);
  const hits = shown.surfaces.map((surface) => surface.pick(camera.position, ray)).filter(Boolean);
  return hits.sort((a, b) => a.distance - b.distance)[0] ?? null;
}

function pickPoint(x, y) {
  const hit = pick(x, y);
  return hit?.surface.place(hit).point;
}

function click(x, y) {
  if (!$('measure').checked) {
    if (shown) objects.pick(camera.position, camera.ray(x, y, canvas.clientWidth / canvas.clientHeight));
    return;
  }
  const hit = pick(x, y);
  if (hit) measure.add(hit.surface.place(hit));
  isDirty = true;
}

// On small screens the surface comes first.
$('panel').open = innerWidth > 900;
const controls = new Controls(canvas, camera, { changed: moved, pick: pickPoint, click });

$('channel').addEventListener('input', () => { [$('low').value, $('high').value] = ['', '']; });
for (const id of ['colour', 'tolerance', 'triangles', 'wireframe', 'channel', 'light', 'low', 'high']) {
  $(id).addEventListener('input', () => {
    settingsChanged();
    moved();
  });
}
$('fly').addEventListener('input', () => { controls.isFlying = $('fly').checked; canvas.focus(); });
$('measure').addEventListener('input', () => { measure.clear(); isDirty = true; });
$('up').addEventListener('input', () => whole());
$('whole').addEventListener('click', () => whole());
$('share').addEventListener('click', async () => {
  const link = address();
  history.replaceState(null, '', link);
  const done = await navigator.clipboard?.writeText(link).then(() => true, () => false);
  $('share').textContent = done ? 'Copied' : 'It is in the address bar';
  setTimeout(() => { $('share').textContent = 'Copy link to this view'; }, 1500);
});
$('choose').addEventListener('change', () => {
  const [file] = $('choose').files;
  if (file) show(file, file.name);
});
const upAxis = () => ($('up').value === 'z' ? [0, 0, 1] : [0, 1, 0]);
function flyTo(box) {
  camera.showAll(box, upAxis(), canvas.clientWidth / canvas.clientHeight);
  moved();
}
function whole() {
  if (shown && bounds()) camera.showAll(bounds(), upAxis(), canvas.clientWidth / canvas.clientHeight);
  moved();
}

addEventListener('keydown', ({ key, target, ctrlKey, metaKey, altKey }) => {
  if (ctrlKey || metaKey || altKey || target.matches?.('select, input[type=range], input[type=number], input[type=search]')) return;
  const box = { f: 'fly', m: 'measure', x: 'wireframe', l: 'light' }[key];
  if (box) $(box).click();
  const act = { i: 'isolate', j: 'all', g: 'go', Escape: 'none' }[key];
  if (act) objects.act(act);
  if (key === 'h' && objects.selected) objects.act('hide');
  else if (key === 'h') whole();
});
for (const name of ['dragover', 'dragleave', 'drop']) {
  addEventListener(name, (event) => {
    event.preventDefault();
    document.body.classList.toggle('over', name === 'dragover');
    const [file] = (name === 'drop' && event.dataTransfer?.files) || [];
    if (file) show(file, file.name);
  });
}
addEventListener('resize', ask);
addEventListener('hashchange', applyAddress);
addEventListener('pagehide', () => opening?.abort());

try {
  renderer = new Renderer(canvas);
  renderer.onrestored = ask;
  requestAnimationFrame(frame);
  const url = new URLSearchParams(location.search).get('url');
  if (url) show(url, decodeURIComponent(url.split(/[?#]/)[0].split('/').at(-1) || url));
} catch (error) {
  complain('This page cannot draw', error.message);
}

/** For tests, and for whoever looks at the console. */
globalThis.lodpackViewer = { camera, measure, objects, pick, show, times, get shown() { return shown; }, get last() { return last; }, get renderer() { return renderer; } };
