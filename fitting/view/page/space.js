// The skin in space: membrane coloured by gap or displacement, taxels as bars, contacts.

import {
  AmbientLight, DirectionalLight, OrbitControls, PerspectiveCamera, Scene, WebGLRenderer,
} from "./three.min.js";
import { Bodies } from "./bodies.js";
import { Contacts } from "./contacts.js";
import { Membrane } from "./membrane.js";
import { reachOf } from "./section.js";
import { Taxels } from "./taxels.js";

export const MM = 1000; // drawn in millimetres

export class Space {
  constructor(canvas, legend) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(35, 1, 1, 5000);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => { this.due = true; });
    this.scene.add(new AmbientLight(0xffffff, 1.6));
    const light = new DirectionalLight(0xffffff, 1.8);
    this.camera.add(light);
    light.position.set(0.4, 1, 0.3);
    this.scene.add(this.camera);
    this.legend = legend;
    this.options = { colour: "gap", exaggeration: 1, ellipses: 10 };
    this.parts = null;
    this.picture = null;
    this.due = true;
  }

  describe(skin) {
    if (this.parts) for (const part of Object.values(this.parts)) this.scene.remove(part.group);
    this.skin = skin;
    this.parts = {
      membrane: new Membrane(skin, this.legend),
      taxels: new Taxels(skin),
      contacts: new Contacts(skin),
      bodies: new Bodies(skin),
    };
    for (const part of Object.values(this.parts)) this.scene.add(part.group);
    const [half, height] = reachOf(skin);
    const size = MM * Math.max(2 * half, skin.width);
    this.camera.position.set(0.9 * size, 1.75 * size, 1.55 * size);
    this.controls.target.set(0, 0.4 * MM * height, 0);
    this.controls.update();
    this.due = true;
  }

  // Arrows that can be dragged.
  handles() {
    return (this.parts?.contacts.drawn ?? []).filter(({ contact }) => contact.along);
  }

  option(name, value) {
    if (name.startsWith("show-")) this.parts[name.slice(5)].group.visible = value;
    else this.options[name] = name === "colour" ? value : Number(value);
    if (this.picture) this.show(this.picture);
    this.due = true;
  }

  show(picture) {
    this.picture = picture;
    const now = { ...this.skin, ...(picture.header.geometry ?? {}) };
    this.parts.membrane.show(picture, now, this.options);
    this.parts.taxels.show(picture, now);
    this.parts.contacts.show(picture, now, this.options);
    this.parts.bodies.show(picture);
    this.due = true;
  }

  draw() {
    const canvas = this.renderer.domElement;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    const density = Math.min(window.devicePixelRatio || 1, 2);
    if (canvas.width !== Math.floor(width * density) || canvas.height !== Math.floor(height * density)) {
      this.renderer.setPixelRatio(density);
      this.renderer.setSize(width, height, false);
      this.camera.aspect = width / Math.max(height, 1);
      this.camera.updateProjectionMatrix();
      this.due = true;
    }
    if (!this.due || !this.parts) return;
    this.due = false;
    this.renderer.render(this.scene, this.camera);
  }
}
