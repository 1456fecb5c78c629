// The undeformed section, as the points of the grid tell it: in metres, x to the right, y to the crown.

// Foot of a place on the inner face and its outward normal, between the points of the grid.
export function footAt(skin, angle) {
  const last = skin.grid_angle.length - 1;
  const half = skin.grid_angle[last];
  const at = Math.min(Math.max(((angle / half + 1) / 2) * last, 0), last);
  const i = Math.min(Math.floor(at), last - 1);
  const mix = (rows, k) => rows[i][k] + (at - i) * (rows[i + 1][k] - rows[i][k]);
  const [nx, ny] = [mix(skin.normal, 0), mix(skin.normal, 1)];
  const length = Math.hypot(nx, ny);
  return { x: mix(skin.place, 0), y: mix(skin.place, 1), nx: nx / length, ny: ny / length };
}

// Oil gap at a point of the grid, which a slider makes larger or smaller.
export const gapAt = (skin, now, i) => (skin.gap[i] * now.oil_gap) / skin.oil_gap;

// Height over the inner face of a grid's point that moves by (u, v): exact on a circle.
export function heightOf(skin, i, u, v) {
  const [nx, ny] = skin.normal[i];
  const [up, along, bend] = [u * nx + v * ny, u * ny - v * nx, skin.curvature[i]];
  const size = Math.hypot(1 + bend * up, bend * along);
  return (2 * up + bend * (up * up + along * along)) / (1 + size);
}

// Half the width of the section and its height.
export function reachOf(skin) {
  const reach = (k) => Math.max(...skin.place.map((point) => Math.abs(point[k])));
  return [reach(0), reach(1)];
}
