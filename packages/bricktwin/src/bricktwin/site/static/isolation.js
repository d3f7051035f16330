// Isolation of the page, which browsers ask for before page and worker may share memory. The site's service worker adds what a
// plain file server does not send; the page has to be loaded once more for it.

const TRIED = "bricks-isolation-tried";

// Whether the page may begin; else it is being loaded again.
export async function isolate() {
  if (!("serviceWorker" in navigator) || !isSecureContext) return true;
  try {
    const ready = navigator.serviceWorker.register("./service_worker.js").then(() => navigator.serviceWorker.ready);
    if (crossOriginIsolated || sessionStorage.getItem(TRIED)) return true;
    sessionStorage.setItem(TRIED, "yes");
    await Promise.race([ready, new Promise((_, reject) => setTimeout(reject, 5000))]);
    location.reload();
    return false;
  } catch {
    return true; // a private window, or no room: it works without
  }
}

// Once the page is at work, the rest of the site is fetched for use without a network.
let isAsked = false;
export async function keepForOffline() {
  if (isAsked || !navigator.serviceWorker?.controller) return;
  isAsked = true;
  const { files } = await (await fetch("files.json")).json();
  for (const name of Object.keys(files)) {
    const isWanted = !name.endsWith(".py") && !(await caches.match(new URL(name, location.href).href));
    // Without a network it is tried again at the next visit.
    if (isWanted) await fetch(name).then((response) => response.arrayBuffer()).catch(() => null);
  }
}
