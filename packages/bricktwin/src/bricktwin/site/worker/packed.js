// Files that are stored compressed, as plain file servers do not compress: `name.packed` holds `name` in gzip's format.

const TYPES = { wasm: "application/wasm", zip: "application/zip", json: "application/json", js: "text/javascript", mjs: "text/javascript" };

export async function fetchPacked(url) {
  const response = await fetch(`${url}.packed`);
  if (!response.ok) throw new Error(`${url} is not there (${response.status})`);
  const [probe, whole] = response.body.tee(), reader = probe.getReader(), { value } = await reader.read();
  reader.cancel();
  // A server may have unpacked it on the way.
  const isPacked = value && value[0] === 0x1f && value[1] === 0x8b;
  const body = isPacked ? whole.pipeThrough(new DecompressionStream("gzip")) : whole;
  const type = TYPES[String(url).split(".").pop()] ?? "application/octet-stream";
  return new Response(body, { headers: { "content-type": type } });
}

// A module that is stored compressed, and imports no other one.
export async function importPacked(url) {
  const address = URL.createObjectURL(await (await fetchPacked(url)).blob());
  try {
    return await import(address);
  } finally {
    URL.revokeObjectURL(address);
  }
}
