// Loads that are dragged over the outer face by their arrows: the pointer's place on the skin moves sliders.

import { Vector3 } from "./three.min.js";
import { triangles } from "./membrane.js";

const MM = 1000;
const NEAR = 14; // of an arrow, to take it [px]

export class Drag {
  constructor(space, move) {
    this.space = space;
    this.move = move; // what a slider is moved by: its name and value
    this.taken = null;
    const canvas = space.renderer.domElement;
    const take = (event) => {
      this.taken = event.button === 0 ? this.#nearest(event) : null;
      if (!this.taken) return;
      const [px, py] = this.#seen(event);
      this.beside = [px - this.taken.at[0], py - this.taken.at[1]]; // of the foot, which follows
      event.stopImmediatePropagation(); // the view does not turn meanwhile
      canvas.setPointerCapture(event.pointerId);
    };
    canvas.addEventListener("pointerdown", take, { capture: true });
    canvas.addEventListener("pointermove", (event) => {
      if (this.taken) this.#to(event);
      else canvas.style.cursor = event.buttons === 0 && this.#nearest(event) ? "grab" : "";
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { this.taken = null; });
  }

  describe(skin) {
    const thick = skin.thickness;
    this.axial = skin.grid_axial.length === 1 ? [-skin.width / 2, skin.width / 2] : skin.grid_axial;
    this.told = skin.told;
    this.face = skin.place.flatMap(([x, y], i) => {
      const [nx, ny] = skin.normal[i];
      return this.axial.map((z) => new Vector3(MM * (x + thick * nx), MM * (y + thick * ny), MM * z));
    });
    this.faces = triangles(skin.place.length, this.axial.length);
  }

  #seen(event) {
    const box = this.space.renderer.domElement.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top, box.width, box.height];
  }

  // The arrow under the pointer, if it moves sliders.
  #nearest(event) {
    const [px, py, width, height] = this.#seen(event);
    const flat = (point) => {
      const p = point.clone().project(this.space.camera);
      return [((p.x + 1) / 2) * width, ((1 - p.y) / 2) * height];
    };
    let best = null;
    for (const handle of this.space.handles()) {
      const [[ax, ay], [bx, by]] = [flat(handle.foot), flat(handle.end)];
      const [dx, dy] = [bx - ax, by - ay];
      const share = Math.min(Math.max(((px - ax) * dx + (py - ay) * dy) / (dx * dx + dy * dy || 1), 0), 1);
      const distance = Math.hypot(px - ax - share * dx, py - ay - share * dy);
      if (distance < NEAR && (!best || distance < best.distance)) best = { ...handle, distance, at: [ax, ay] };
    }
    return best;
  }

  #to(event) {
    const place = this.#under(event);
    if (!place) return;
    const { along, across } = this.taken.contact;
    const told = this.told[along.endsWith(".arc") ? "arc" : "angle"];
    const i = Math.min(Math.floor(place.row), told.length - 2);
    this.move(along, told[i] + (place.row - i) * (told[i + 1] - told[i]));
    if (across) this.move(across, place.axial);
  }

  // Where the pointer's ray meets the outer face first: row of the grid, and axial position [m].
  #under(event) {
    const [x, y, width, height] = this.#seen(event);
    const [px, py] = [x - this.beside[0], y - this.beside[1]];
    const at = (z) => new Vector3((2 * px) / width - 1, 1 - (2 * py) / height, z).unproject(this.space.camera);
    const from = at(-1);
    const way = at(1).sub(from);
    const [e1, e2, s, h, g] = Array.from({ length: 5 }, () => new Vector3());
    const columns = this.axial.length;
    let best = null;
    for (let k = 0; k < this.faces.length; k += 3) {
      const [a, b, c] = this.faces.slice(k, k + 3);
      e1.subVectors(this.face[b], this.face[a]);
      e2.subVectors(this.face[c], this.face[a]);
      h.crossVectors(way, e2);
      const size = e1.dot(h);
      if (Math.abs(size) < 1e-12) continue;
      s.subVectors(from, this.face[a]);
      const u = s.dot(h) / size;
      g.crossVectors(s, e1);
      const v = way.dot(g) / size;
      const t = e2.dot(g) / size;
      if (u < 0 || v < 0 || u + v > 1 || t < 0 || (best && t >= best.t)) continue;
      const mixed = (value) => value(a) + u * (value(b) - value(a)) + v * (value(c) - value(a));
      best = { t, row: mixed((n) => Math.floor(n / columns)), axial: mixed((n) => this.axial[n % columns]) };
    }
    return best;
  }
}
