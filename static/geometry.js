// Between the flattened plane (metres) and the pane (CSS pixels).

export class Transform {
  constructor() {
    this.scale = 1000; // CSS pixels per metre
    this.x = 0;
    this.y = 0;
  }

  toPane(u, v) {
    return { x: this.x + this.scale * u, y: this.y + this.scale * v };
  }

  toPlane(x, y) {
    return { u: (x - this.x) / this.scale, v: (y - this.y) / this.scale };
  }

  pan(dx, dy) {
    this.x += dx;
    this.y += dy;
  }

  /** Zoom and keep what is under (x, y) there. */
  zoom(factor, x, y) {
    const scale = Math.min(200000, Math.max(50, this.scale * factor));
    this.x = x - ((x - this.x) * scale) / this.scale;
    this.y = y - ((y - this.y) * scale) / this.scale;
    this.scale = scale;
  }

  /** Fit a box of the plane into the pane, with a margin (CSS pixels). */
  fit(box, width, height, margin) {
    const across = Math.max(1e-6, box.right - box.left);
    const down = Math.max(1e-6, box.bottom - box.top);
    this.scale = Math.max(50, Math.min((width - 2 * margin) / across, (height - 2 * margin) / down));
    this.x = width / 2 - (this.scale * (box.left + box.right)) / 2;
    this.y = height / 2 - (this.scale * (box.top + box.bottom)) / 2;
  }
}

/** The box of the plane that a raster covers; pixel centres have integer coordinates. */
export function boxOf(grid) {
  const [u, v] = grid.origin_uv_m;
  const d = grid.pixel_size_m;
  return { left: u - d / 2, top: v - d / 2, right: u + (grid.cols - 0.5) * d, bottom: v + (grid.rows - 0.5) * d };
}

export const contains = (a, b) => a.left <= b.left && a.top <= b.top && a.right >= b.right && a.bottom >= b.bottom;

export const grown = (box, by) => ({ left: box.left - by, top: box.top - by, right: box.right + by, bottom: box.bottom + by });

export function union(a, b) {
  if (!a || !b) return a ?? b;
  return {
    left: Math.min(a.left, b.left), top: Math.min(a.top, b.top),
    right: Math.max(a.right, b.right), bottom: Math.max(a.bottom, b.bottom),
  };
}
