// Service worker of the site: keeps its files for use without a network, and says with each that the page is isolated, which
// a plain file server does not; without that, browsers give no memory that page and worker share.

const SCOPE = new URL("./", self.location).href;
// Other folders of the same web space may have sites of their own, whose files are kept beside.
const OURS = `bricks ${SCOPE} `, CACHE = `${OURS}BUILD-MARK`;
const SHELL = ["./"];
// What runs in the page may run nothing that is not a file of the site. The worker's runtimes make functions of text; and a program
// that somebody was sent runs there, so that nothing leaves the site's own address.
const WORKER_POLICY = "default-src 'self'; script-src 'self' blob: 'unsafe-eval' 'wasm-unsafe-eval'";

self.addEventListener("install", (event) => {
  self.skipWaiting();
  event.waitUntil(caches.open(CACHE).then((cache) => cache.addAll(SHELL)));
});

self.addEventListener("activate", (event) => {
  const isOld = (name) => name.startsWith(OURS) && name !== CACHE;
  event.waitUntil(
    caches.keys().then((names) => Promise.all(names.filter(isOld).map((name) => caches.delete(name)))).then(() => self.clients.claim()),
  );
});

self.addEventListener("fetch", (event) => {
  const { request } = event;
  if (request.method === "GET" && request.url.startsWith(SCOPE)) event.respondWith(answer(request));
});

async function answer(request) {
  const cache = await caches.open(CACHE), url = new URL(request.url);
  url.hash = url.search = "";
  const kept = await cache.match(url.href);
  if (kept) return isolated(kept, url);
  const response = await fetch(url.href, { cache: "no-cache" });
  if (response.ok) await cache.put(url.href, response.clone());
  return isolated(response, url);
}

function isolated(response, url) {
  const headers = new Headers(response.headers);
  headers.set("Cross-Origin-Opener-Policy", "same-origin");
  headers.set("Cross-Origin-Embedder-Policy", "require-corp");
  headers.set("Cross-Origin-Resource-Policy", "same-origin");
  if (url.pathname.endsWith("/worker.js")) headers.set("Content-Security-Policy", WORKER_POLICY);
  return new Response(response.body, { status: response.status, statusText: response.statusText, headers });
}
