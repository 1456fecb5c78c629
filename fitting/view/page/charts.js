// Strip charts: the last half minute, or the whole of a log with a line where it is shown.

const WINDOW = 30; // [s]
const MOST = 4000;

// Round numbers between two ends, about as many as wanted, with their texts.
function ticks(low, high, wanted) {
  const least = Math.max(high - low, 1e-9) / wanted;
  const power = 10 ** Math.floor(Math.log10(least));
  const step = power * [1, 2, 5, 10].find((m) => m * power >= least * (1 - 1e-9));
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push([k * step, (k * step).toFixed(digits)]);
  return found;
}

export class Charts {
  constructor(force, pressure) {
    this.rows = [];
    this.whole = null; // first and last time of a log
    this.now = 0;
    this.charts = [[force, 1, 1], [pressure, 2, 1e-3]];
    this.due = true;
  }

  restart(samples, timeline) {
    this.rows = samples;
    this.whole = timeline ? [timeline.first, timeline.last] : null;
    this.due = true;
  }

  add(time, force, pressure) {
    this.now = time;
    this.due = true;
    if (this.whole) return;
    const last = this.rows[this.rows.length - 1];
    if (last && last[0] >= time) return;
    this.rows.push([time, force, pressure]);
    if (this.rows.length > MOST) this.rows.splice(0, MOST / 4);
  }

  draw() {
    if (!this.due) return;
    this.due = false;
    const begin = Math.max(this.now - WINDOW, 0);
    const [first, last] = this.whole ?? [begin, begin + WINDOW];
    const rows = this.rows.filter((row) => row[0] >= first - 1 && row[0] <= last);
    for (const [canvas, column, scale] of this.charts) this.#one(canvas, rows, column, scale, first, last);
  }

  #one(canvas, rows, column, scale, first, last) {
    const density = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(width * density)) {
      canvas.width = Math.round(width * density);
      canvas.height = Math.round(height * density);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(density, 0, 0, density, 0, 0);
    pen.clearRect(0, 0, width, height);
    const known = rows.map((row) => row[column]).filter((x) => x !== null).map((x) => scale * x);
    let [low, high] = [Math.min(0, ...known), Math.max(0, ...known)];
    if (high - low < 1e-9) high = low + 1;
    const [left, under] = [34, height - 15];
    const y = (value) => under - ((value - low) / (high - low)) * (under - 6);
    const x = (time) => left + ((time - first) / Math.max(last - first, 1e-9)) * (width - left - 4);
    pen.font = "10px system-ui, sans-serif";
    pen.fillStyle = "#52606d";
    pen.strokeStyle = "#e3e8ee";
    const line = (...ends) => { pen.beginPath(); pen.moveTo(...ends[0]); pen.lineTo(...ends[1]); pen.stroke(); };
    pen.textAlign = "right";
    for (const [value, text] of ticks(low, high, 3)) {
      line([left, y(value)], [width - 4, y(value)]);
      pen.fillText(text, left - 4, y(value) + 3);
    }
    pen.textAlign = "center";
    for (const [value, text] of ticks(first, last, 5)) {
      line([x(value), 6], [x(value), under]);
      if (x(value) < width - 14) pen.fillText(text, x(value), height - 4);
    }
    pen.fillText("s", width - 6, height - 4);
    pen.strokeStyle = "#1f6feb";
    pen.lineWidth = 1.5;
    pen.beginPath();
    let down = false;
    for (const row of rows) {
      if (row[column] === null) { down = false; continue; }
      const place = [x(row[0]), y(scale * row[column])];
      if (down) pen.lineTo(...place); else pen.moveTo(...place);
      down = true;
    }
    pen.stroke();
    const end = rows[rows.length - 1];
    if (!this.whole && end && end[column] !== null) {
      pen.fillStyle = "#1f6feb";
      pen.beginPath(); pen.arc(x(end[0]), y(scale * end[column]), 2.5, 0, 2 * Math.PI); pen.fill();
    }
    if (this.whole) {
      pen.strokeStyle = "#c0392b";
      line([x(this.now), 0], [x(this.now), under]);
    }
  }
}
