// The page: opens a file by its address or from the disk, streams it for a camera, and draws it.

import { EtagMismatch, Pool, open } from 'lodpack';
import { Camera, VERTICAL_FOV } from './camera.js';
import { Controls } from './controls.js';
import { Measure } from './measure.js';
import { Renderer } from './renderer.js';

const $ = (id) => document.getElementById(id);
const canvas = $('canvas');
const camera = new Camera();
const measure = new Measure($('marks'));
let renderer;
let shown = null; // The open file: { file, stream, pool, from }.
let opening = null; // Aborts what is being opened.
let isDirty = true; // Whether something has to be drawn.
let wantsFrame = true; // Whether the stream has to be asked.
let isAsking = false;
let last = null; // The last frame of the stream.
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
    if (controller.signal.aborted) return file.close();
    const stream = await file.stream();
    const { maxTextureSize } = renderer;
    const pool = new Pool({ infoSize: 2, infoOf: ({ level, error }) => [level, error], images: file.channels.length > 0 || file.kind === 'heights', maxTextureSize });
    pool.onremove = (slab) => renderer.forget(slab);
    shown = { file, stream, pool, from, name };
    stream.onprogress = ask;
    document.title = `${name} – lodpack`;
    $('hint').hidden = true;
    if (!file.bounds) {
      complain('There is nothing to see', `${name} is a sound file, but its surface is empty.`);
    } else {
      // Heights go along z.
      if (file.kind === 'heights') $('up').value = 'z';
      camera.showAll(file.bounds, upAxis());
      listChannels(file.channels);
      applyAddress();
    }
    ask();
  } catch (error) {
    if (controller.signal.aborted) return;
    complain(`${name} cannot be opened`, error.message, () => show(from, name));
  }
}

function close() {
  if (!shown) return;
  shown.pool.slabs.forEach((slab) => renderer.forget(slab));
  shown.file.close();
  shown = null;
  last = null;
  measure.clear();
  isDirty = true;
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

/** Asks the stream what to draw: one question at a time. */
async function follow() {
  if (!shown || isAsking || !wantsFrame) return;
  isAsking = true;
  wantsFrame = false;
  const { stream, pool, file, name, from } = shown;
  try {
    const frame = await stream.frame({ view: view() });
    if (shown?.stream !== stream) return;
    const begun = performance.now();
    pool.update(frame);
    times.update = performance.now() - begun;
    last = frame;
    if (frame.uploads.length + frame.drops.length > 0) isDirty = true;
    if (frame.problems.length > 0) {
      complain('Parts of the surface cannot be loaded', `${frame.problems[0]}. What is loaded stays visible, coarser than wanted.`, () => {
        if (file.failure instanceof EtagMismatch) show(from, name);
        else stream.retry().then(ask);
      });
    }
  } catch (error) {
    if (shown?.stream === stream) complain(`${name} cannot be shown`, error.message, () => show(from, name));
  } finally {
    isAsking = false;
  }
}

/** Offers the channels of a file: at first the first one of colours, or normals. */
function listChannels(channels) {
  const known = channels.filter(({ kind }) => kind !== 'unknown');
  $('channel').replaceChildren(...known.map(({ name }) => new Option(name, `channel ${name}`)), new Option('none'));
  $('channel').value = firstChannel();
  $('channel-row').hidden = known.length === 0;
  [$('low').value, $('high').value, $('scale').hidden, $('light-row').hidden] = ['', '', true, true];
}

/** What is chosen while nobody chooses. */
function firstChannel() {
  const first = ['colour', 'normal'].map((wanted) => shown?.file.channels.find(({ kind }) => kind === wanted)).find(Boolean);
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
  const { stream, name } = shown;
  const wanted = JSON.stringify([chosenChannel(), chosenRange()]);
  if (shown.channel === wanted || (!shown.channel && chosenChannel() === 'none')) return;
  shown.channel = wanted;
  try {
    await stream.show(chosenChannel(), { range: chosenRange(), normals: true });
  } catch (error) {
    if (shown?.stream !== stream) return;
    shown.channel = undefined;
    complain(`A channel of ${name} cannot be shown`, error.message, showChannel);
    return;
  }
  if (shown?.stream !== stream || shown.channel !== wanted) return;
  const digits = (value) => String(Number(value.toPrecision(5)));
  [$('low').placeholder, $('high').placeholder] = stream.range?.map(digits) ?? ['', ''];
  $('scale').hidden = !stream.range;
  $('light-row').hidden = !stream.channel;
  ask();
}

function statistics() {
  if (!shown) return '';
  const { file, pool } = shown;
  const { requests, bytes } = file.traffic;
  const number = (value) => Math.round(value).toLocaleString('en').replaceAll(',', ' ');
  const lines = [`${number(pool.triangleCount)} triangles`, `${number(pool.roots.size)} roots`];
  lines.push(`${number(bytes / 1000)} of ${number(file.byteLength / 1000)} kB`, `${requests} requests`);
  if (last) {
    lines.push(last.shows === 'picture' ? `${last.errorPx.toFixed(2)} px error` : last.shows);
    lines.push(last.isComplete ? 'complete' : `${last.lateRoots} roots coarser`);
    if (last.lateImages > 0) lines.push(`${last.lateImages} roots without image`);
  }
  if (pool.images) {
    const { used, allocated } = pool.texels;
    lines.push(`${number(used / 1000)} of ${number(allocated / 1000)} k texels`);
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
  const pool = shown?.pool ?? emptyPool;
  renderer.draw(pool, camera, shown?.stream.origin ?? [0, 0, 0], {
    colour: $('colour').value, levelCount: shown?.file.heights?.depthCount ?? shown?.file.levels.length ?? 1, tolerance: 2 ** Number($('tolerance').value), wireframe: $('wireframe').checked,
    image: imageOf(shown?.stream.channel), isUnlit: !$('light').checked,
  });
  measure.draw(camera, [canvas.clientWidth, canvas.clientHeight], VERTICAL_FOV);
  times.frame = performance.now() - begun;
  $('hud').textContent = statistics();
}
const emptyPool = new Pool({ infoSize: 2 });
const IMAGES = { label: 'classes', drawing: 'classes', normal: 'directions' };
const imageOf = (channel) => (channel ? IMAGES[channel.kind] ?? 'colours' : undefined);

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
  $('wireframe').checked = settings.get('wire') === '1';
  const channels = [...$('channel').options].map(({ value }) => value);
  const channel = settings.get('channel');
  const option = [channel === 'none' ? 'none' : `channel ${channel}`].find((value) => channels.includes(value));
  if (channels.length > 0) $('channel').value = option ?? firstChannel();
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
  const { stream: { origin }, pool } = shown;
  const from = camera.position.map((value, axis) => value - origin[axis]);
  return pool.raycast(from, camera.ray(x, y, canvas.clientWidth / canvas.clientHeight));
}

function pickPoint(x, y) {
  const hit = pick(x, y);
  return hit?.point.map((value, axis) => value + shown.stream.origin[axis]);
}

function click(x, y) {
  if (!$('measure').checked) return;
  const hit = pick(x, y);
  if (hit) measure.add(hit, shown.stream.origin);
  isDirty = true;
}

// On small screens the surface comes first.
$('panel').open = innerWidth > 900;
const controls = new Controls(canvas, camera, { changed: moved, pick: pickPoint, click });

$('channel').addEventListener('input', () => { [$('low').value, $('high').value] = ['', '']; });
for (const id of ['colour', 'tolerance', 'wireframe', 'channel', 'light', 'low', 'high']) {
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
function whole() {
  if (shown?.file.bounds) camera.showAll(shown.file.bounds, upAxis());
  moved();
}

addEventListener('keydown', ({ key, target, ctrlKey, metaKey, altKey }) => {
  if (ctrlKey || metaKey || altKey || target.matches?.('select, input[type=range], input[type=number]')) return;
  const box = { f: 'fly', m: 'measure', x: 'wireframe', l: 'light' }[key];
  if (box) $(box).click();
  if (key === 'h') whole();
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
globalThis.lodpackViewer = { camera, measure, pick, show, times, get shown() { return shown; }, get last() { return last; }, get renderer() { return renderer; } };
