// Headless Chromium for tests.

import { chromium } from 'playwright-core';
import { fileURLToPath } from 'node:url';

const path = (from) => fileURLToPath(new URL(from, import.meta.url));

/** What the tests serve: the page, the package, the vectors, and what cargo's test wrote. */
export const mounts = {
  '/': path('../../../viewer-min/web'),
  '/lodpack/': path('..'),
  '/vectors/': path('../../../format-spec/vectors'),
  ...(process.env.LODPACK_REFERENCE ? { '/files/': process.env.LODPACK_REFERENCE } : {}),
};

const quiet = [
  '--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking', '--disable-component-update', '--disable-sync',
];

/** A browser that draws on the processor. */
export function launch({ hasWebGpu = false } = {}) {
  const webGl = ['--use-angle=swiftshader', '--enable-unsafe-swiftshader'];
  const webGpu = ['--enable-unsafe-webgpu', '--use-webgpu-adapter=swiftshader', '--enable-features=Vulkan', '--use-vulkan=swiftshader'];
  return chromium.launch({
    executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
    args: [...quiet, ...webGl, ...(hasWebGpu ? webGpu : [])],
    ignoreDefaultArgs: hasWebGpu ? ['--disable-gpu'] : [],
  });
}

/** A page that fails the test if its scripts throw. */
export async function newPage(browser, errors, options = { viewport: { width: 480, height: 360 } }) {
  const page = await browser.newPage(options);
  page.setDefaultTimeout(60_000);
  page.on('pageerror', (error) => errors.push(error.stack));
  return page;
}
