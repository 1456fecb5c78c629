// Colour scales: blue where the gap is wide, red where it is narrow; and one way for sizes.

const DIVERGING = [[178, 24, 43], [239, 138, 98], [253, 219, 199], [247, 247, 247], [209, 229, 240], [103, 169, 207], [33, 102, 172]];
const SEQUENTIAL = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];

function mixed(stops, share) {
  const x = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
  const k = Math.min(Math.floor(x), stops.length - 2);
  return stops[k].map((c, i) => (c + (x - k) * (stops[k + 1][i] - c)) / 255);
}

// Linear light, as the renderer takes vertex colours.
export function table(name, size = 256) {
  const stops = name === "gap" ? DIVERGING : SEQUENTIAL;
  const found = new Float32Array(3 * size);
  for (let k = 0; k < size; k++) {
    mixed(stops, k / (size - 1)).forEach((c, i) => { found[3 * k + i] = Math.pow(c, 2.2); });
  }
  return found;
}

export function drawBar(canvas, name) {
  const pen = canvas.getContext("2d");
  const stops = name === "gap" ? DIVERGING : SEQUENTIAL;
  for (let x = 0; x < canvas.width; x++) {
    const [r, g, b] = mixed(stops, x / (canvas.width - 1)).map((c) => Math.round(255 * c));
    pen.fillStyle = `rgb(${r},${g},${b})`;
    pen.fillRect(x, 0, 1, canvas.height);
  }
}
