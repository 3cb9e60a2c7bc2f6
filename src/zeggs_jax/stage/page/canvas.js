// ---------------------------------------------------------------- Canvas 2-D renderer: shaded outlines, far to near, where WebGL2 is missing

class CanvasRenderer {
  constructor(canvas, figures) {
    this.context = canvas.getContext("2d");
    if (!this.context) throw new Error("no canvas at all");
    this.canvas = canvas; this.name = "canvas";
    this.pieces = new Map(figures.map(figure => [figure, figure.shapes.flatMap(part => this.cut(part))]));
  }

  /** A shape as pieces between neighbouring ellipses; each is drawn as the outline of its points. */
  cut(part) {
    const rings = skin(part, part.thick > 0.02 ? 12 : 8, 2);
    return part.stations.slice(1).map((to, k) => {
      const from = part.stations[k], end = k + 2 === part.stations.length;
      return { tone: part.tone, width: Math.max(from.width, to.width), from, to, points: rings.slice(k ? k + 2 : 0, end ? rings.length : k + 4).flat() };
    });
  }

  draw(views, look) {
    const context = this.context;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    for (const view of views) {
      const [x, y, w, h] = view.box;
      context.save();
      context.beginPath(); context.rect(x, this.canvas.height - y - h, w, h); context.clip();
      context.translate(x + w / 2, this.canvas.height - y - h / 2);
      context.scale(w / 2, -h / 2);
      context.lineWidth = 2 / h;
      this.drawView(context, view, look, w / h);
      context.restore();
    }
  }

  drawView(context, view, look, aspect) {
    const { figure, project, eye, lamp, centre } = view;
    const screen = p => {
      const w = project[3] * p[0] + project[7] * p[1] + project[11] * p[2] + project[15];
      return [0, 1].map(r => (project[r] * p[0] + project[4 + r] * p[1] + project[8 + r] * p[2] + project[12 + r]) / Math.max(w, 0.05));
    };
    this.drawGrid(context, screen, centre, look, eye);
    const shade = new Path2D(), shapes = this.pieces.get(figure).map(piece => {
      const cloud = piece.points.map(({ joint, point }) => figure.toWorld(joint, point));
      const [from, to] = [piece.from, piece.to].map(s => figure.toWorld(s.joint, s.centre)), middle = add(from, add(to, from, -1), 0.5);
      if (eye[1] > figure.floor) trace(shade, hull(cloud.map(p => screen(add(p, lamp, (figure.floor - p[1]) / lamp[1])))));
      return { ...piece, cloud, middle, along: unit(add(to, from, -1)), depth: Math.hypot(...add(eye, middle, -1)) };
    });
    context.fillStyle = "rgba(20, 20, 30, 0.2)";
    context.fill(shade);
    shapes.sort((a, b) => b.depth - a.depth);
    for (const { cloud, middle, along, width, tone } of shapes) {
      const path = new Path2D();
      trace(path, hull(cloud.map(screen)));
      const toEye = unit(add(eye, middle, -1));
      let across = cross(along, toEye);
      across = Math.hypot(...across) > 0.05 ? unit(across) : unit(cross([0, 1, 0], toEye));
      const [p, q] = [screen(add(middle, across, -width)), screen(add(middle, across, width))];
      const gradient = context.createLinearGradient(...p, ...q);
      [-0.95, -0.5, 0, 0.5, 0.95].forEach((s, k) => {
        const n = unit(add(add([0, 0, 0], across, s), toEye, Math.sqrt(1 - s * s)));
        const light = 0.6 + 0.14 * n[1] + 0.5 * Math.max(dot(n, lamp), 0);
        gradient.addColorStop(k / 4, `rgb(${[0, 1, 2].map(c => Math.min(255, Math.round(255 * figure.tones[tone * 3 + c] * light))).join()})`);
      });
      context.fillStyle = gradient;
      context.fill(path);
    }
  }

  drawGrid(context, screen, centre, look, eye) {
    if (eye[1] < centre[1]) return;
    const path = new Path2D(), reach = 1.5, every = 0.5;
    const [x0, z0] = [Math.round(centre[0] / every) * every, Math.round(centre[2] / every) * every];
    for (let d = -reach; d <= reach + 1e-6; d += every)
      for (const [a, b] of [[[x0 + d, z0 - reach], [x0 + d, z0 + reach]], [[x0 - reach, z0 + d], [x0 + reach, z0 + d]]]) {
        path.moveTo(...screen([a[0], centre[1], a[1]])); path.lineTo(...screen([b[0], centre[1], b[1]]));
      }
    context.strokeStyle = `rgba(${look.line.map(c => Math.round(c * 255)).join()}, 0.14)`;
    context.stroke(path);
  }
}

function trace(path, points) {
  points.forEach((p, i) => i ? path.lineTo(...p) : path.moveTo(...p));
  path.closePath();
}

/** Convex hull of points in the plane, counter-clockwise. */
function hull(points) {
  const sorted = points.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const half = list => {
    const out = [];
    for (const p of list) {
      while (out.length > 1) {
        const [a, b] = [out[out.length - 2], out[out.length - 1]];
        if ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0) break;
        out.pop();
      }
      out.push(p);
    }
    return out.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}
