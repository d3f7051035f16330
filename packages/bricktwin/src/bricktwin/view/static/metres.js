// Marks on the floor: a label at each whole metre near the robot.

import { distance, project } from "./matrices.js";

export function writeMetres(labels, view, target, floor) {
  const marks = [];
  if (floor !== null) {
    for (let x = Math.round(target[0]) - 2; x <= Math.round(target[0]) + 2; x++) marks.push([[x, Math.round(target[1])], `${x} m`]);
  }
  while (labels.childElementCount < marks.length) labels.append(document.createElement("span"));
  [...labels.children].forEach((label, i) => {
    const point = marks[i] && project(view, [...marks[i][0], floor]);
    const isBelow = marks[i] && distance(marks[i][0], target) < 0.3; // the robot stands there
    label.hidden = !point || isBelow || Math.abs(point[0]) > 1 || Math.abs(point[1]) > 1;
    if (label.hidden) return;
    label.textContent = marks[i][1];
    label.style.left = `${(point[0] * 0.5 + 0.5) * 100}%`;
    label.style.top = `${(0.5 - point[1] * 0.5) * 100}%`;
  });
}
