// Arrays of a drawing, which are base64 in its JSON.

export function bytesOf(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

// Points, normals and faces of a mesh. Little-endian, as are all computers with WebGL.
export function arraysOf({ points, normals, faces }) {
  return [
    new Float32Array(bytesOf(points).buffer),
    new Int8Array(bytesOf(normals).buffer),
    new Uint32Array(bytesOf(faces).buffer),
  ];
}
