// The panel beside the picture: statuses in words, values, sliders, timeline, messages.

const $ = (id) => document.getElementById(id);
const LINKS = {
  connected: ["port connected", "connected"],
  waiting: ["waiting for the device", ""],
  silent: ["device silent", "lost"],
  link_lost: ["port lost", "lost"],
  layout_mismatch: ["another layout", "lost"],
};

export class Panel {
  constructor(send) {
    this.send = send;
    this.dragging = false;
    this.sliders = {};
    $("play").onclick = () => send({ type: "play", value: $("play").textContent === "Play" });
    $("speed").onchange = () => send({ type: "speed", value: Number($("speed").value) });
    $("seek").oninput = () => { this.dragging = true; send({ type: "seek", value: Number($("seek").value) }); };
    $("seek").onchange = () => { this.dragging = false; };
  }

  describe(skin) {
    $("title").textContent = skin.title;
    document.title = `${skin.title} – suas view`;
    $("sliders").hidden = !skin.sliders;
    $("sliders").replaceChildren(...(skin.sliders ?? []).map((slider) => this.#slider(slider)));
    $("timeline").hidden = !skin.timeline;
    if (skin.timeline) {
      Object.assign($("seek"), { min: skin.timeline.first, max: skin.timeline.last, value: 0 });
      $("speed").replaceChildren(...skin.timeline.speeds.map((speed) => {
        const option = document.createElement("option");
        Object.assign(option, { value: speed, textContent: `× ${speed}` });
        return option;
      }));
    }
  }

  #set(name, value) {
    this.send({ type: "set", name, value });
  }

  // Move a slider, as far as it goes.
  move(name, value) {
    const { input, write } = this.sliders[name];
    input.value = value;
    write();
    this.#set(name, Number(input.value));
  }

  // A row of a slider: name, control, value with its unit.
  #slider(slider) {
    const [label, input, output] = ["label", "input", "output"].map((name) => document.createElement(name));
    const write = () => { output.textContent = `${(slider.scale * input.value).toPrecision(3)} ${slider.unit}`; };
    Object.assign(input, { type: "range", min: slider.least, max: slider.most, step: "any", value: slider.value });
    input.dataset.name = slider.name;
    input.oninput = () => { write(); this.#set(slider.name, Number(input.value)); };
    this.sliders[slider.name] = { input, write };
    write();
    const name = document.createElement("span");
    name.textContent = slider.label;
    label.append(name, input, output);
    return label;
  }

  history(told) {
    $("sentences").replaceChildren(...told.sentences.toReversed().map((text) => {
      const item = document.createElement("li");
      item.textContent = text;
      return item;
    }));
  }

  show(header, skin) {
    $("status").textContent = header.status.replaceAll("_", " ");
    $("message").textContent = header.message;
    const [words, kind] = LINKS[header.link] ?? [`${skin.source}, from this machine`, ""];
    this.link(words, kind);
    $("values").replaceChildren(...header.values.map(([name, value]) => {
      const row = document.createElement("tr");
      for (const text of [name, value]) row.insertCell().textContent = text;
      return row;
    }));
    if (skin.timeline) {
      if (!this.dragging) $("seek").value = header.t_s;
      $("place").textContent = `${header.t_s.toFixed(2)} of ${skin.timeline.last.toFixed(2)} s`;
      $("play").textContent = header.playing ? "Stop" : "Play";
      $("speed").value = header.speed;
    }
  }

  link(words, kind) {
    $("link").textContent = words;
    $("link").className = kind;
  }
}
