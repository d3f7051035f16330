// Gestures on a scene: one finger or the left button pulls what moves, or turns; two fingers or another button move; wheel and pinch
// zoom; a double click resets the view.

import { distance } from "./matrices.js";

export function listen(scene) {
  const { canvas, camera } = scene, pointers = new Map();
  let held = -1;
  const move = (action, ...values) => {
    camera[action](...values);
    scene.requestDraw();
  };
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("dblclick", () => scene.home());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    move("zoom", Math.exp(event.deltaY * 0.001));
  }, { passive: false });
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    held = scene.onPull && event.button === 0 && pointers.size === 1 ? scene.bodyAt(event.offsetX, event.offsetY) : -1;
    if (held >= 0) scene.pull(held, event.offsetX, event.offsetY);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => {
      pointers.delete(event.pointerId);
      if (held >= 0) scene.onPull(-1);
      held = -1;
    });
  }
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    if (held >= 0) return scene.pull(held, event.offsetX, event.offsetY);
    const now = [event.clientX, event.clientY], change = [now[0] - before[0], now[1] - before[1]];
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
      move("zoom", distance(before, other) / Math.max(1, distance(now, other)));
      move("pan", change[0] / 2, change[1] / 2);
    } else if (event.buttons > 1 || event.shiftKey) move("pan", ...change);
    else move("turn", ...change);
    pointers.set(event.pointerId, now);
  });
}
