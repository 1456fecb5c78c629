// One mesh over the grid's points, its value as the colour of the vertices; wall beneath.

import {
  BufferAttribute, BufferGeometry, Color, DoubleSide, DynamicDrawUsage, Group,
  LineBasicMaterial, LineSegments, Mesh, MeshLambertMaterial,
} from "./three.min.js";
import { drawBar, table } from "./colours.js";
import { gapAt, heightOf } from "./section.js";

const MM = 1000;
const SIZE = 256; // colours of a scale
const FLOOR = 0.05; // of the oil gap: the least end of a scale
const FADE = 0.98; // per picture: how slowly a scale shrinks again

// Of a grid whose points lie along the arc and, for each of these, across.
export function triangles(arc, across) {
  const found = [];
  for (let i = 0; i + 1 < arc; i++) {
    for (let j = 0; j + 1 < across; j++) {
      const k = i * across + j;
      found.push(k, k + 1, k + across, k + 1, k + across + 1, k + across);
    }
  }
  return found;
}

export class Membrane {
  constructor(skin, legend) {
    this.skin = skin;
    this.legend = legend;
    this.group = new Group();
    this.arc = skin.grid_angle.length;
    this.section = skin.grid_axial.length === 1;
    this.axial = this.section ? [-skin.width / 2, skin.width / 2] : skin.grid_axial;
    this.reach = { gap: 1e-5, displacement: 1e-5 };
    this.tables = { gap: table("gap", SIZE), displacement: table("displacement", SIZE) };
    const points = this.arc * this.axial.length;
    this.position = new BufferAttribute(new Float32Array(3 * points), 3).setUsage(DynamicDrawUsage);
    this.colour = new BufferAttribute(new Float32Array(3 * points), 3).setUsage(DynamicDrawUsage);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", this.position);
    geometry.setAttribute("color", this.colour);
    geometry.setIndex(triangles(this.arc, this.axial.length));
    const look = { vertexColors: true, side: DoubleSide, transparent: true, opacity: 0.72, depthWrite: false };
    this.mesh = new Mesh(geometry, new MeshLambertMaterial(look));
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = 1;
    const lines = new BufferGeometry();
    lines.setAttribute("position", this.position);
    lines.setIndex(this.#lines());
    const thin = new LineBasicMaterial({ color: 0x334155, transparent: true, opacity: 0.25 });
    this.lines = new LineSegments(lines, thin);
    this.lines.frustumCulled = false;
    this.lines.renderOrder = 2;
    this.wall = null;
    this.group.add(this.mesh, this.lines);
  }

  #lines() {
    const found = [];
    const across = this.axial.length;
    const [stepI, stepJ] = [Math.max(1, Math.round(this.arc / 24)), Math.max(1, Math.round(across / 12))];
    for (let i = 0; i < this.arc; i++) {
      for (let j = 0; j < across; j++) {
        const k = i * across + j;
        if (j + 1 < across && i % stepI === 0) found.push(k, k + 1);
        if (i + 1 < this.arc && j % stepJ === 0) found.push(k, k + across);
      }
    }
    return found;
  }

  #rebuildWall(now) {
    if (this.wall?.userData.gap === now.oil_gap) return;
    if (this.wall) { this.group.remove(this.wall); this.wall.geometry.dispose(); }
    const geometry = new BufferGeometry();
    const points = this.skin.place.flatMap(([x, y], i) => {
      const [[nx, ny], gap] = [this.skin.normal[i], gapAt(this.skin, now, i)];
      return [-1, 1].flatMap((side) => [MM * (x - gap * nx), MM * (y - gap * ny), (MM * side * now.width) / 2]);
    });
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(points), 3));
    geometry.setIndex(triangles(this.arc, 2));
    geometry.computeVertexNormals();
    this.wall = new Mesh(geometry, new MeshLambertMaterial({ color: new Color(0x9aa5b1), side: DoubleSide }));
    this.wall.userData.gap = now.oil_gap;
    this.group.add(this.wall);
  }

  show({ header, moved }, now, options) {
    this.#rebuildWall(now);
    const across = this.axial.length;
    const scale = header.scale;
    const values = new Float32Array(this.arc * across);
    let largest = FLOOR * now.oil_gap;
    for (let i = 0; i < this.arc; i++) {
      const [x, y] = this.skin.place[i];
      for (let j = 0; j < across; j++) {
        const k = i * across + j;
        const p = 3 * (this.section ? i : k);
        const [u, v, w] = [scale * moved[p], scale * moved[p + 1], scale * moved[p + 2]];
        const gap = gapAt(this.skin, now, i) + heightOf(this.skin, i, u, v);
        values[k] = options.colour === "gap" ? gap - now.oil_gap : Math.hypot(u, v, w);
        largest = Math.max(largest, Math.abs(values[k]));
        const e = options.exaggeration;
        this.position.array[3 * k] = MM * (x + e * u);
        this.position.array[3 * k + 1] = MM * (y + e * v);
        this.position.array[3 * k + 2] = MM * (this.axial[j] + e * w);
      }
    }
    const reach = Math.max(largest, FADE * this.reach[options.colour]);
    this.reach[options.colour] = reach;
    const colours = this.tables[options.colour];
    for (let k = 0; k < values.length; k++) {
      const share = options.colour === "gap" ? 0.5 + values[k] / (2 * reach) : values[k] / reach;
      const at = 3 * Math.round(Math.min(Math.max(share, 0), 1) * (SIZE - 1));
      for (let i = 0; i < 3; i++) this.colour.array[3 * k + i] = colours[at + i];
    }
    this.position.needsUpdate = this.colour.needsUpdate = true;
    this.mesh.geometry.computeVertexNormals();
    this.#legend(options.colour, now.oil_gap, reach);
  }

  #legend(name, gap, reach) {
    const [low, bar, high, title] = ["low", "bar", "high", "title"].map((x) => this.legend.querySelector(`#legend-${x}`));
    const ends = name === "gap" ? [Math.max(gap - reach, 0), gap + reach] : [0, reach];
    [low, high].forEach((place, k) => { place.textContent = (MM * ends[k]).toPrecision(3); });
    const words = name === "gap" ? "gap to the wall [mm]" : "displacement [mm]";
    if (title.textContent !== words) { title.textContent = words; drawBar(bar, name); }
  }
}
