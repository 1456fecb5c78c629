// The page: takes pictures from the socket, draws the newest, says when it has drawn it.

import { Charts } from "./charts.js";
import { Drag } from "./drag.js";
import { Panel } from "./panel.js";
import { decoded } from "./picture.js";
import { Space } from "./space.js";

const AGAIN = 1000; // between two tries to reach the server [ms]
const $ = (id) => document.getElementById(id);

let socket = null;
let skin = null;
let newest = null;
const send = (message) => { if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message)); };
const panel = new Panel(send);
const charts = new Charts($("force"), $("pressure"));
let space = null;
let drag = null;
try {
  space = new Space($("canvas"), $("legend"));
  drag = new Drag(space, (name, value) => panel.move(name, value));
} catch (error) {
  panel.link(`this browser draws no WebGL: ${error.message}`, "lost");
}

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket`);
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({ data }) => {
    if (typeof data !== "string") { newest = data; return; }
    const message = JSON.parse(data);
    if (message.type === "skin") {
      skin = message;
      panel.describe(skin);
      space?.describe(skin);
      drag?.describe(skin);
    } else if (message.type === "history") {
      charts.restart(message.samples, message.whole ? skin.timeline : null);
      panel.history(message);
    }
  };
  socket.onclose = () => {
    panel.link("suas view has ended, or can't be reached", "lost");
    setTimeout(connect, AGAIN);
  };
}

function draw() {
  if (newest && skin) {
    const picture = decoded(newest, skin);
    newest = null;
    panel.show(picture.header, skin);
    charts.add(picture.header.t_s, picture.header.force_N, picture.header.oil_pressure_Pa);
    space?.show(picture);
    space?.draw();
    send({ type: "drawn", number: picture.header.number });
    document.body.dataset.drawn = picture.header.number;
  } else {
    space?.draw();
  }
  charts.draw();
  requestAnimationFrame(draw);
}

for (const id of ["colour", "exaggeration", "ellipses", "show-membrane", "show-taxels", "show-contacts"]) {
  $(id).onchange = () => space?.option(id, $(id).type === "checkbox" ? $(id).checked : $(id).value);
}
connect();
draw();
