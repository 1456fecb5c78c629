// Taxels as bars on the wall, as high as their counts above rest; grey where they aren't used.

import { BoxGeometry, Color, Group, InstancedMesh, Matrix4, MeshLambertMaterial, Quaternion, Vector3 } from "./three.min.js";
import { footAt } from "./section.js";

const MM = 1000;
const [LONGEST, UNDER_BODIES] = [22, 7]; // [mm]
const LEAST_SCALE = 20; // counts of the longest bar, at least
const FADE = 0.98;
const LOOKS = [0x2b8a3e, 0xadb5bd, 0xd6336c, 0xf08c00].map((c) => new Color(c)); // by state
const FEWER = new Color(0x1864ab); // counts below rest

export class Taxels {
  constructor(skin) {
    this.skin = skin;
    this.group = new Group();
    this.most = LEAST_SCALE;
    this.longest = skin.bodies?.length ? UNDER_BODIES : LONGEST; // bars shall not hide what presses
    const count = skin.taxels.length;
    this.bars = new InstancedMesh(new BoxGeometry(1, 1, 1), new MeshLambertMaterial(), Math.max(count, 1));
    this.bars.count = count;
    this.bars.frustumCulled = false;
    this.group.add(this.bars);
  }

  show({ change, states }, now) {
    let largest = LEAST_SCALE;
    for (let k = 0; k < change.length; k++) if (states[k] === 0) largest = Math.max(largest, Math.abs(change[k]));
    this.most = Math.max(largest, FADE * this.most);
    const [up, out, turn, place, size] = [new Vector3(0, 1, 0), new Vector3(), new Quaternion(), new Vector3(), new Vector3()];
    const matrix = new Matrix4();
    this.skin.taxels.forEach((taxel, k) => {
      const height = Math.max(0.6, (this.longest * Math.min(Math.abs(change[k]), this.most)) / this.most);
      const { x, y, nx, ny } = footAt(this.skin, taxel.angle);
      const over = height / 2 - (MM * taxel.gap * now.oil_gap) / this.skin.oil_gap;
      out.set(nx, ny, 0);
      turn.setFromUnitVectors(up, out);
      place.set(MM * x + over * nx, MM * y + over * ny, MM * taxel.axial);
      const wide = 0.62 * MM * taxel.diameter;
      matrix.compose(place, turn, size.set(wide, height, wide));
      this.bars.setMatrixAt(k, matrix);
      this.bars.setColorAt(k, states[k] === 0 && change[k] < 0 ? FEWER : LOOKS[states[k]]);
    });
    this.bars.instanceMatrix.needsUpdate = true;
    if (this.bars.instanceColor) this.bars.instanceColor.needsUpdate = true;
  }
}
