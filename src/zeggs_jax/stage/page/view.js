// ---------------------------------------------------------------- how a figure looks, and from where it is seen

/** Skin, top, legs, shoes, eyes, hair; the top takes the figure's own colour. */
function tonesOf(colour) {
  const rgb = hex => [1, 3, 5].map(i => parseInt(hex.slice(i, i + 2), 16) / 255);
  return ["#ddb294", colour, "#4d525c", "#3a3d44", "#26272b", "#4b3f39"].flatMap(rgb);
}

/** Gives a figure its shapes, its colours and the places where its shoes touch the floor. */
function dressed(figure) {
  figure.shapes = figure.parts.map(readPart);
  figure.tones = tonesOf(figure.colour);
  const shoes = figure.shapes.filter(part => part.tone === 3).slice(0, 6);
  figure.contacts = () => {
    const out = new Float32Array(24);
    shoes.forEach((part, i) => out.set([...figure.toWorld(part.stations[1].joint, part.stations[1].centre), 0.045 * figure.stature], i * 4));
    return out;
  };
  return figure;
}

/** The canvas and what draws on it: WebGL, else (or if the address asks with #renderer=canvas) 2-D on a fresh canvas. */
function rendererOf(canvas, figures) {
  try {
    if (new URLSearchParams(location.hash.slice(1)).get("renderer") === "canvas") throw new Error("asked for");
    return [canvas, new WebGLRenderer(canvas, figures)];
  } catch {
    const fresh = canvas.cloneNode();                    // a canvas that has tried WebGL may refuse 2-D
    canvas.replaceWith(fresh);
    return [fresh, new CanvasRenderer(fresh, figures)];
  }
}

const camera = { yaw: 0.32, pitch: 0.1, zoom: 1, home: { yaw: 0.32, pitch: 0.1, zoom: 1 } };
const TANGENT = Math.tan(13 * Math.PI / 180);

/** Number of columns that gives the figures the most room: a view likes to be 0.8 times as wide as high. */
function columnsFor(count, width, height) {
  let best = [0, 1];
  for (let columns = 1; columns <= count; columns++) {
    const rows = Math.ceil(count / columns);
    const room = Math.min(width / columns / 0.8, height / rows) * (1 - 0.02 * (columns * rows - count));
    if (room > best[0] * 1.001) best = [room, columns];
  }
  return best[1];
}

/** Camera of one view: turns with the others about its own figure, seen from where that figure looks; `room` is what all need. */
function viewOf(figure, room, cell, scale, canvas, time) {
  const [x, z] = figure.follow(time), centre = [x, figure.floor, z], aspect = cell.w / cell.h;
  const yaw = figure.facing + camera.yaw, close = Math.min(Math.max((camera.zoom - 1) / 1.5, 0), 1);
  const half = 0.5 * room.tall, target = add(centre, [0, half * (1 - close) + 0.8 * figure.stature * close, 0]);
  const distance = Math.max(1.13 * half / TANGENT, 1.04 * room.wide / (TANGENT * aspect)) / camera.zoom;
  const flat = Math.cos(camera.pitch);
  const eye = add(target, [Math.sin(yaw) * flat, Math.sin(camera.pitch), Math.cos(yaw) * flat], distance);
  const project = times(perspective(TANGENT, aspect, 0.1, distance + 12), lookAt(eye, target));
  const side = figure.facing + 0.75;
  const lamp = unit([Math.sin(side) * 0.62, 1, Math.cos(side) * 0.62]);
  const box = [cell.x, canvas.clientHeight - cell.y - cell.h, cell.w, cell.h].map(v => Math.round(v * scale));
  return { figure, box, project, eye, centre, lamp };
}

