// Strip charts: the last half minute, or the whole of a log with a line where it is shown.

const WINDOW = 30; // [s]
const MOST = 4000;

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
    const [first, last] = this.whole ?? [this.now - WINDOW, this.now];
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
    const y = (value) => height - 4 - ((value - low) / (high - low)) * (height - 18);
    const x = (time) => ((time - first) / Math.max(last - first, 1e-9)) * width;
    pen.strokeStyle = "#d5dae0";
    pen.beginPath(); pen.moveTo(0, y(0)); pen.lineTo(width, y(0)); pen.stroke();
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
      pen.beginPath(); pen.arc(x(end[0]) - 2, y(scale * end[column]), 2.5, 0, 2 * Math.PI); pen.fill();
    }
    if (this.whole) {
      pen.strokeStyle = "#c0392b";
      pen.beginPath(); pen.moveTo(x(this.now), 0); pen.lineTo(x(this.now), height); pen.stroke();
    }
    pen.fillStyle = "#52606d";
    pen.font = "10px system-ui, sans-serif";
    pen.fillText(high.toPrecision(3), 3, 10);
    pen.fillText(`${first.toFixed(1)} s`, 3, height - 6);
    pen.textAlign = "right";
    pen.fillText(`${last.toFixed(1)} s`, width - 3, height - 6);
    pen.textAlign = "left";
  }
}
