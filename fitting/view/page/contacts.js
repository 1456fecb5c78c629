// Contacts as arrows that end on the outer face, with the ellipse that holds them with 95 %.

import {
  BufferAttribute, BufferGeometry, ConeGeometry, CylinderGeometry, Group, InstancedMesh, LineBasicMaterial,
  LineLoop, Matrix4, MeshLambertMaterial, Quaternion, Vector3,
} from "./three.min.js";
import { footAt } from "./section.js";

const MM = 1000;
const MOST = 16; // contacts
const PER_NEWTON = 2.5; // [mm], up to
const LONGEST = 45;
const [HEAD, THICK] = [9, 1.1]; // [mm]
const ROUND = 64; // points of an ellipse

export class Contacts {
  constructor(skin) {
    this.skin = skin;
    this.group = new Group();
    const red = new MeshLambertMaterial({ color: 0xc92a2a });
    this.shafts = new InstancedMesh(new CylinderGeometry(1, 1, 1, 12), red, MOST);
    this.heads = new InstancedMesh(new ConeGeometry(1, 1, 16), red, MOST);
    this.rings = Array.from({ length: MOST }, () => {
      const geometry = new BufferGeometry();
      geometry.setAttribute("position", new BufferAttribute(new Float32Array(3 * ROUND), 3));
      const ring = new LineLoop(geometry, new LineBasicMaterial({ color: 0x862e9c, depthTest: false, transparent: true }));
      ring.renderOrder = 3;
      ring.frustumCulled = false;
      return ring;
    });
    for (const mesh of [this.shafts, this.heads]) { mesh.frustumCulled = false; mesh.count = 0; }
    this.group.add(this.shafts, this.heads, ...this.rings);
  }

  show({ header }, now, options) {
    const found = header.contacts.slice(0, MOST);
    this.shafts.count = this.heads.count = found.length;
    this.rings.forEach((ring) => { ring.visible = false; });
    this.drawn = [];
    const [up, matrix, turn] = [new Vector3(0, 1, 0), new Matrix4(), new Quaternion()];
    found.forEach((contact, k) => {
      const { x, y, nx, ny } = footAt(this.skin, contact.angle);
      const way = Math.atan2(nx, ny) - contact.turn; // outwards along the force's line
      const out = new Vector3(Math.sin(way), Math.cos(way), 0);
      const foot = new Vector3(MM * (x + now.thickness * nx), MM * (y + now.thickness * ny), MM * contact.axial);
      const length = Math.min(HEAD + PER_NEWTON * Math.abs(contact.force), LONGEST);
      const pulls = contact.force < 0;
      const at = (distance) => foot.clone().addScaledVector(out, distance);
      turn.setFromUnitVectors(up, pulls ? out : out.clone().negate());
      const shaft = length - HEAD;
      matrix.compose(at(pulls ? shaft / 2 : HEAD + shaft / 2), turn, new Vector3(THICK, Math.max(shaft, 0.1), THICK));
      this.shafts.setMatrixAt(k, matrix);
      matrix.compose(at(pulls ? shaft + HEAD / 2 : HEAD / 2), turn, new Vector3(3, HEAD, 3));
      this.heads.setMatrixAt(k, matrix);
      this.drawn.push({ contact, foot, end: at(length) });
      if (contact.ellipse) this.#ring(this.rings[k], contact, now.thickness, options.ellipses);
    });
    this.shafts.instanceMatrix.needsUpdate = this.heads.instanceMatrix.needsUpdate = true;
  }

  #ring(ring, contact, thickness, scale) {
    const [long, short, turn] = contact.ellipse;
    const [c, s] = [Math.cos(turn), Math.sin(turn)];
    const place = ring.geometry.attributes.position;
    for (let k = 0; k < ROUND; k++) {
      const round = (2 * Math.PI * k) / ROUND;
      const [a, b] = [scale * long * Math.cos(round), (contact.line ? 1 : scale) * short * Math.sin(round)];
      const { x, y, nx, ny } = footAt(this.skin, contact.angle + (a * c - b * s) / contact.outer_rate);
      const height = MM * thickness + 0.5;
      place.setXYZ(k, MM * x + height * nx, MM * y + height * ny, MM * (contact.axial + a * s + b * c));
    }
    place.needsUpdate = true;
    ring.visible = true;
  }
}
