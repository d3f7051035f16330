// A user's own picture as the floor of a robot: read from a file by the page, put into a robot's file by page and worker alike.

export const TABLE_MM = [2362, 1143]; // of FIRST LEGO League
const PX_PER_MM = 1; // most that are kept: a sensor's spot has a radius of 1 mm and more
const LARGEST_STRETCH = 0.03, HEIGHT_M = 0.0012;

// An image file on `size_mm`, of which the height may be missing: it follows from the image.
export async function readPicture(file, [width_mm, height_mm]) {
  const image = await createImageBitmap(file).catch(() => null);
  if (!image) throw new Error(`${file.name} is no image that can be read; choose a PNG or JPEG file`);
  height_mm ??= Math.round((width_mm * image.height) / image.width);
  if (Math.abs(Math.log((image.width * height_mm) / (image.height * width_mm))) > LARGEST_STRETCH) {
    throw new Error(`${file.name} has ${image.width} x ${image.height} pixels, which would be stretched on ${width_mm} x ${height_mm} mm`);
  }
  const columns = Math.min(image.width, Math.max(1, Math.round(width_mm * PX_PER_MM)));
  const rows = Math.min(image.height, Math.max(1, Math.round(height_mm * PX_PER_MM)));
  const canvas = Object.assign(document.createElement("canvas"), { width: columns, height: rows });
  const context = canvas.getContext("2d");
  // What is transparent is white, as paper is.
  context.fillStyle = "white";
  context.fillRect(0, 0, columns, rows);
  context.imageSmoothingQuality = "high";
  context.drawImage(image, 0, 0, columns, rows);
  const { data } = context.getImageData(0, 0, columns, rows), pixels = new Uint8Array(3 * columns * rows);
  for (let index = 0; index < columns * rows; index++) pixels.set(data.subarray(4 * index, 4 * index + 3), 3 * index);
  return { columns, size_mm: [width_mm, height_mm], pixels: base64(pixels), drawn: canvas.toDataURL("image/png").split(",")[1] };
}

// A robot's file with the picture on its floor, in place of a mat that lies there.
export function withPicture(file, picture) {
  const { scene } = file.robot, [width_mm, height_mm] = picture.size_mm;
  const laid = { is: "Picture", pixels: { is: "bytes", base64: picture.pixels }, columns: picture.columns, size_mm: picture.size_mm, at_mm: [0, 0], heading_deg: 0 };
  const objects = [laid, ...scene.objects.filter((object) => object.is !== "Field")];
  const { drawing } = file, [x, y] = [width_mm / 2000, height_mm / 2000];
  const square = {
    points: base64(new Uint8Array(new Float32Array([-x, -y, 0, x, -y, 0, x, y, 0, -x, y, 0]).buffer)),
    normals: base64(new Uint8Array([0, 0, 127, 0, 0, 0, 127, 0, 0, 0, 127, 0, 0, 0, 127, 0])),
    faces: base64(new Uint8Array(new Uint32Array([0, 1, 2, 0, 2, 3]).buffer)),
  };
  const shape = {
    mesh: drawing.meshes.length, colour: [1, 1, 1, 1], position: [0, 0, HEIGHT_M], wxyz: [1, 0, 0, 0], pattern: "",
    picture: drawing.pictures.length,
  };
  // Its own body, which lies where the model's world is.
  const body = { name: "picture", model_body: 0, shapes: [shape] };
  return {
    robot: { ...file.robot, scene: { ...scene, objects } },
    drawing: { ...drawing, meshes: [...drawing.meshes, square], pictures: [...drawing.pictures, picture.drawn], bodies: [...drawing.bodies, body] },
    start: [...file.start, 0, 0, 0, 1, 0, 0, 0],
  };
}

function base64(bytes) {
  const pieces = [];
  for (let start = 0; start < bytes.length; start += 32768) pieces.push(String.fromCharCode(...bytes.subarray(start, start + 32768)));
  return btoa(pieces.join(""));
}
