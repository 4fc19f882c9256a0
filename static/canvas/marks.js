// What is marked on the flattened view: picks, the gripper of the current one, the scale bar.

import { length, niceLength } from "/static/page/format.js";

export function drawMark(canvas, mark, style) {
  drawDot(canvas.context, canvas.transform.toPane(...mark.uv_m), style.getPropertyValue("--pick"), 4);
}

/** A dot that is seen on any cloth. */
export function drawDot(context, { x, y }, color, radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fillStyle = color;
  context.strokeStyle = "#fff";
  context.lineWidth = 1.5;
  context.fill();
  context.stroke();
}

export function drawPick(canvas, pick, style) {
  const { x, y } = canvas.transform.toPane(...pick.uv_m);
  const context = canvas.context;
  for (const [color, width] of [
    ["#fff", 4.5],
    [style.getPropertyValue("--pick"), 2],
  ]) {
    context.strokeStyle = color;
    context.lineWidth = width;
    context.beginPath();
    context.arc(x, y, 9, 0, 2 * Math.PI);
    for (const [dx, dy] of [
      [1, 0],
      [-1, 0],
      [0, 1],
      [0, -1],
    ]) {
      context.moveTo(x + 5 * dx, y + 5 * dy);
      context.lineTo(x + 14 * dx, y + 14 * dy);
    }
    context.stroke();
  }
  if (pick.grip?.axis_uv) drawGrip(canvas, x, y, pick.grip, style);
}

/** The gripper's axis as a line through the pick, its fingers as bars on both sides of it. */
function drawGrip(canvas, x, y, grip, style) {
  const context = canvas.context;
  const { scale } = canvas.transform;
  const along = canvas.transform.toPaneVector(...grip.axis_uv);
  const [du, dv] = [along.x / scale, along.y / scale];
  const half = (grip.opening_m / 2) * scale;
  for (const [color, width] of [
    ["#fff", 5],
    [style.getPropertyValue("--pick"), 2.5],
  ]) {
    context.strokeStyle = color;
    context.lineWidth = width;
    context.beginPath();
    for (const side of [-1, 1]) {
      context.moveTo(x + 15 * side * du, y + 15 * side * dv);
      context.lineTo(x + 30 * side * du, y + 30 * side * dv);
      const [fx, fy] = [x - side * half * dv, y + side * half * du];
      context.moveTo(fx - 8 * du, fy - 8 * dv);
      context.lineTo(fx + 8 * du, fy + 8 * dv);
    }
    context.stroke();
  }
}

export function drawScale(canvas, style) {
  const context = canvas.context;
  const mm = niceLength((1000 * Math.min(150, 0.3 * canvas.width)) / canvas.transform.scale);
  const width = (mm / 1000) * canvas.transform.scale;
  const x = 14;
  const y = canvas.height - 16;
  context.font = "12px system-ui, sans-serif";
  context.textBaseline = "bottom";
  const label = length(mm);
  context.globalAlpha = 0.85;
  context.fillStyle = style.getPropertyValue("--panel");
  context.fillRect(x - 8, y - 24, Math.max(width, context.measureText(label).width) + 16, 34);
  context.globalAlpha = 1;
  context.fillStyle = style.getPropertyValue("--text");
  strokeScale(context, x, y, width, context.fillStyle);
  context.fillText(label, x + 4, y - 4);
}

/** The bar of a scale, its ends turned up. */
export function strokeScale(context, x, y, width, color) {
  strokeLine(
    context,
    [
      { x, y: y - 5 },
      { x, y },
      { x: x + width, y },
      { x: x + width, y: y - 5 },
    ],
    color,
    1.5,
  );
}

/** A line through points of the pane. */
export function strokeLine(context, points, color, width, dash = []) {
  context.setLineDash(dash);
  context.strokeStyle = color;
  context.lineWidth = width;
  context.beginPath();
  points.forEach((p, i) => (i ? context.lineTo(p.x, p.y) : context.moveTo(p.x, p.y)));
  context.stroke();
  context.setLineDash([]);
}
