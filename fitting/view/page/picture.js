// A picture's message: see fitting/view/picture.py.

export function decoded(buffer, skin) {
  const size = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const points = skin.grid_angle.length * skin.grid_axial.length;
  const taxels = skin.taxels.length;
  let at = 4 + size;
  const moved = new Int16Array(buffer, at, 3 * points);
  at += moved.byteLength;
  const change = new Int16Array(buffer, at, taxels);
  at += change.byteLength;
  const states = new Uint8Array(buffer, at, taxels);
  return { header, moved, change, states };
}
