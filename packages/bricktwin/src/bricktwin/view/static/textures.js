// Pictures on the graphics card.

// A picture is decoded later; `onReady` is called then.
export function makeTexture(gl, png, onReady) {
  const id = gl.createTexture();
  let isFreed = false;
  const texture = {
    isReady: false,
    use(unit) {
      gl.activeTexture(unit);
      gl.bindTexture(gl.TEXTURE_2D, id);
    },
    free() {
      isFreed = true;
      gl.deleteTexture(id);
    },
  };
  createImageBitmap(new Blob([png], { type: "image/png" }), { imageOrientation: "flipY" }).then((image) => {
    if (isFreed) return;
    texture.use(gl.TEXTURE1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, gl.RGB, gl.UNSIGNED_BYTE, image);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    texture.isReady = true;
    onReady();
  });
  return texture;
}
