// Bodies that press on the skin: surfaces in their own frames, moved to where each picture has them.

import { BufferAttribute, BufferGeometry, DoubleSide, Group, Matrix4, Mesh, MeshLambertMaterial } from "./three.min.js";
import { triangles } from "./membrane.js";

const MM = 1000;

export class Bodies {
  constructor(skin) {
    this.group = new Group();
    this.meshes = (skin.bodies ?? []).map((surface) => this.#mesh(skin, surface));
    if (this.meshes.length) this.group.add(...this.meshes);
  }

  // In plane strain a body is as wide as the skin: its outline is drawn out along the axis.
  #mesh(skin, surface) {
    const flat = skin.grid_axial.length === 1;
    const rays = flat ? 2 : 49;
    const rings = surface.length / rays;
    let points = surface;
    let [rows, columns] = [rays, rings];
    if (flat) {
      const outline = [...surface.slice(0, rings).reverse(), ...surface.slice(rings + 1)];
      points = outline.flatMap(([x, , z]) => [-1, 1].map((side) => [x, (side * skin.width) / 2, z]));
      [rows, columns] = [outline.length, 2];
    }
    const geometry = new BufferGeometry();
    const place = new Float32Array(points.flat().map((x) => MM * x));
    geometry.setAttribute("position", new BufferAttribute(place, 3));
    geometry.setIndex(triangles(rows, columns));
    geometry.computeVertexNormals();
    const look = { color: 0x7048a8, side: DoubleSide, transparent: true, opacity: 0.45, depthWrite: false };
    const mesh = new Mesh(geometry, new MeshLambertMaterial(look));
    mesh.matrixAutoUpdate = false;
    mesh.visible = false;
    mesh.renderOrder = 2;
    return mesh;
  }

  show({ header }) {
    this.meshes.forEach((mesh, k) => {
      const now = header.bodies?.[k];
      mesh.visible = Boolean(now);
      if (!now) return;
      const [x, y, z] = now.axes;
      const at = now.tip.map((t) => MM * t);
      mesh.matrix = new Matrix4().set(
        x[0], y[0], z[0], at[0], x[1], y[1], z[1], at[1], x[2], y[2], z[2], at[2], 0, 0, 0, 1,
      );
      mesh.matrixWorldNeedsUpdate = true;
    });
  }
}
