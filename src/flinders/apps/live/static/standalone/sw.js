/**
 * Service worker: the page works offline after it has been loaded once.
 *
 * All files of one version are in one cache, under a name that changes with their content, so that a page never mixes
 * two versions. A new version is used once all pages of the old one are closed.
 */

/// <reference path="./globals.d.ts" />

const worker = /** @type {any} */ (self);
const scope = worker.registration.scope;
const version = `flinders ${scope} ${PAGE.version}`;

worker.addEventListener("install", (/** @type {any} */ event) => event.waitUntil(fill()));
worker.addEventListener("activate", (/** @type {any} */ event) => event.waitUntil(Promise.all([clean(), worker.clients.claim()])));
worker.addEventListener("fetch", (/** @type {any} */ event) => {
    if (event.request.method === "GET" && event.request.url.startsWith(scope)) event.respondWith(found(event.request));
});

/** Cache all files, and the 3-D view if available. */
async function fill() {
    const cache = await caches.open(version);
    await cache.addAll(PAGE.files.map((path) => new Request(path, { cache: "no-cache" })));
    await cache.add(PAGE.scene).catch(() => {});
}

/** Delete caches of other versions of this page; other pages of the host have their own caches. */
async function clean() {
    const names = await caches.keys();
    await Promise.all(names.filter((other) => other.startsWith(`flinders ${scope} `) && other !== version).map((other) => caches.delete(other)));
}

/**
 * From the cache, else from the host.
 * @param {Request} request
 * @returns {Promise<Response>}
 */
async function found(request) {
    const cache = await caches.open(version);
    const isPage = request.mode === "navigate" && /\/(index\.html)?$/.test(new URL(request.url).pathname);
    const cached = await cache.match(isPage ? scope : request, { ignoreSearch: true });
    if (cached) return cached;
    const answer = await fetch(request);
    if (answer.ok && request.url.startsWith(scope + PAGE.kept)) cache.put(request, answer.clone()); // a language that is in use
    return answer;
}
