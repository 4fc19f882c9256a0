// The triangles between the samples, as they lie on the plane.

export function trianglePairs(lesson, level) {
  const triangles = lesson.array.triangles;
  const pairs = new Int32Array(2 * triangles.length);
  for (let i = 0; i < triangles.length; i += 3) {
    const [a, b, c] = [0, 1, 2].map((k) => level.local[triangles[i + k]]);
    pairs.set([a, b, b, c, c, a], 2 * i);
  }
  return pairs;
}

export function fillTriangles(sheet, map, points, lesson, level) {
  const context = sheet.context;
  const triangles = lesson.array.triangles;
  context.beginPath();
  for (let i = 0; i < triangles.length; i += 3) {
    for (let k = 0; k < 3; k++) {
      const p = 2 * level.local[triangles[i + k]];
      const place = map.at(points[p], points[p + 1]);
      if (k === 0) context.moveTo(...place);
      else context.lineTo(...place);
    }
    context.closePath();
  }
  context.save();
  context.globalAlpha = 0.14;
  context.fillStyle = sheet.color.accent;
  context.fill();
  context.restore();
}
