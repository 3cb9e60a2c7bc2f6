// ---------------------------------------------------------------- WebGL2 renderer: skinned body, soft shadow, studio floor

const BODY_VERTEX = `#version 300 es
precision highp float;
layout(location=0) in vec3 position; layout(location=1) in vec3 normal; layout(location=2) in vec2 jointTone;
uniform sampler2D joints; uniform mat4 project; uniform vec3 tones[6];
out vec3 vNormal; out vec3 vWorld; out vec3 vColour;
void main() {
  int j = int(jointTone.x) * 3;
  vec4 r0 = texelFetch(joints, ivec2(j, 0), 0), r1 = texelFetch(joints, ivec2(j + 1, 0), 0), r2 = texelFetch(joints, ivec2(j + 2, 0), 0);
  vec4 p = vec4(position, 1.0);
  vWorld = vec3(dot(r0, p), dot(r1, p), dot(r2, p));
  vNormal = vec3(dot(r0.xyz, normal), dot(r1.xyz, normal), dot(r2.xyz, normal));
  vColour = tones[int(jointTone.y)];
  gl_Position = project * vec4(vWorld, 1.0);
}`;

const SHADOW = `
uniform highp sampler2DShadow shadowMap; uniform mat4 lightProject;
float lit(vec3 world, float radius) {               // share of the lamp that reaches a point
  vec3 q = (lightProject * vec4(world, 1.0)).xyz * 0.5 + 0.5;
  if (any(greaterThan(abs(q.xy - 0.5), vec2(0.498)))) return 1.0;
  float turn = 6.2831853 * fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715)))), sum = 0.0;
  for (int i = 0; i < 18; i++) {
    float r = sqrt((float(i) + 0.5) / 18.0) * radius, a = float(i) * 2.39996323 + turn;
    sum += texture(shadowMap, vec3(q.xy + r * vec2(cos(a), sin(a)), q.z));
  }
  return sum / 18.0;
}`;

const BODY_FRAGMENT = `#version 300 es
precision highp float;
in vec3 vNormal; in vec3 vWorld; in vec3 vColour; out vec4 colour;
uniform vec3 eye, lamp; uniform float floorHeight, dark;
${SHADOW}
void main() {
  vec3 n = normalize(vNormal), v = normalize(eye - vWorld), h = normalize(lamp + v);
  float key = dot(n, lamp), open = lit(vWorld + n * 0.012 + lamp * 0.01, 0.006);
  float lambert = max(key * 0.9 + 0.1, 0.0) * mix(0.0, 1.0, open);
  float sky = 0.5 + 0.5 * n.y, low = smoothstep(0.0, 0.5, vWorld.y - floorHeight);
  vec3 fillSide = normalize(vec3(-lamp.x, 0.25, lamp.z));
  vec3 light = vec3(1.06, 1.0, 0.93) * 1.12 * lambert
    + mix(vec3(0.24, 0.21, 0.19), vec3(0.47, 0.50, 0.56), sky) * mix(0.72, 1.0, low) * mix(1.0, 0.8, dark)
    + vec3(0.13, 0.15, 0.19) * max(dot(n, fillSide), 0.0);
  float edge = pow(1.0 - max(dot(n, v), 0.0), 3.5);
  vec3 base = vColour * vColour;
  vec3 c = base * light + vec3(0.10) * edge * sky + vec3(0.07) * pow(max(dot(n, h), 0.0), 36.0) * open;
  c = c * (1.0 + c * 0.12) / (1.0 + c * 0.28);
  colour = vec4(sqrt(clamp(c, 0.0, 1.0)), 1.0);
}`;

const FLOOR_VERTEX = `#version 300 es
precision highp float;
layout(location=0) in vec2 corner; uniform mat4 project; uniform vec3 centre; uniform float reach; out vec3 vWorld;
void main() { vWorld = centre + vec3(corner.x, 0.0, corner.y) * reach; gl_Position = project * vec4(vWorld, 1.0); }`;

const FLOOR_FRAGMENT = `#version 300 es
precision highp float;
in vec3 vWorld; out vec4 colour;
uniform vec3 centre, lineColour; uniform vec4 blobs[6]; uniform float reach, dark; uniform vec3 eye;
${SHADOW}
float lines(vec2 p, float every) {
  vec2 q = p / every, w = fwidth(q), d = abs(fract(q - 0.5) - 0.5) / max(w, 1e-5);
  vec2 k = 1.0 - smoothstep(0.3, 1.3, d); return max(k.x, k.y) * (1.0 - smoothstep(0.15, 0.5, max(w.x, w.y)));
}
void main() {
  float far = length(vWorld.xz - centre.xz), fade = 1.0 - smoothstep(0.35 * reach, 0.95 * reach, far);
  if (fade <= 0.0) discard;
  float shade = 1.0 - lit(vWorld, 0.004 + 0.011 * clamp(far, 0.0, 1.5));
  float contact = 0.0;
  for (int i = 0; i < 6; i++) { vec3 d = vWorld - blobs[i].xyz; contact += blobs[i].w * blobs[i].w / (dot(d, d) + 0.4 * blobs[i].w * blobs[i].w); }
  float ink = (0.34 * shade + 0.30 * (1.0 - exp(-0.55 * contact))) * mix(1.0, 1.5, dark);
  float grid = max(0.35 * lines(vWorld.xz, 0.25), lines(vWorld.xz, 1.0)) * mix(0.16, 0.2, dark);
  float above = smoothstep(-0.02, 0.05, eye.y - vWorld.y);
  float a = min(ink, 0.85) * fade * above, g = grid * fade * fade * above;
  colour = vec4(lineColour * g * (1.0 - a) + vec3(0.02, 0.02, 0.03) * a, a + g * (1.0 - a));
}`;

class WebGLRenderer {
  constructor(canvas, figures) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: true, premultipliedAlpha: true, preserveDrawingBuffer: false });
    if (!gl) throw new Error("WebGL2 is not available");
    this.gl = gl; this.canvas = canvas; this.name = "webgl";
    this.body = this.program(BODY_VERTEX, BODY_FRAGMENT);
    this.caster = this.program(BODY_VERTEX, "#version 300 es\nprecision highp float;\nin vec3 vColour; out vec4 c; void main() { c = vec4(vColour, 1.0); }");
    this.floor = this.program(FLOOR_VERTEX, FLOOR_FRAGMENT);
    this.quad = this.mesh(new Float32Array([-1, -1, 1, -1, 1, 1, -1, 1]), [0, 2, 1, 0, 3, 2], [2]);
    this.models = new Map(figures.map(figure => [figure, this.model(figure)]));
    this.makeShadow(1536);
  }

  program(vertex, fragment) {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text); gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(program));
    const where = {};
    return { program, at: name => where[name] ??= gl.getUniformLocation(program, name) };
  }

  mesh(vertices, indices, sizes) {
    const gl = this.gl, vao = gl.createVertexArray(), stride = 4 * sizes.reduce((a, b) => a + b);
    gl.bindVertexArray(vao);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer()); gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.STATIC_DRAW);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer()); gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(indices), gl.STATIC_DRAW);
    sizes.reduce((offset, size, i) => { gl.enableVertexAttribArray(i); gl.vertexAttribPointer(i, size, gl.FLOAT, false, stride, offset); return offset + 4 * size; }, 0);
    gl.bindVertexArray(null);
    return { vao, count: indices.length };
  }

  /** All parts of a figure in one mesh, fine where they are thick. */
  model(figure) {
    const gl = this.gl, vertices = [], indices = [];
    for (const part of figure.shapes) {
      const around = part.thick > 0.06 ? 40 : part.thick > 0.02 ? 24 : 12, rings = skin(part, around, part.thick > 0.02 ? 8 : 4);
      const base = vertices.length / 8;
      for (const { joint, point, normal } of rings.flat()) vertices.push(...point, ...normal, joint, part.tone);
      for (let r = 0; r + 1 < rings.length; r++)
        for (let t = 0; t < around; t++) {
          const a = base + r * around + t, b = base + r * around + (t + 1) % around;
          indices.push(a, b, a + around, b, b + around, a + around);
        }
    }
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, figure.count * 3, 1);
    for (const f of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, f, gl.NEAREST);
    return { ...this.mesh(new Float32Array(vertices), indices, [3, 3, 2]), texture };
  }

  makeShadow(size) {
    const gl = this.gl;
    this.shadow = { size, texture: gl.createTexture(), buffer: gl.createFramebuffer() };
    gl.bindTexture(gl.TEXTURE_2D, this.shadow.texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, size, size);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
    for (const f of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, f, gl.LINEAR);
    for (const w of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, w, gl.CLAMP_TO_EDGE);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadow.buffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.shadow.texture, 0);
    gl.drawBuffers([gl.NONE]);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** Draws every view: {figure, box: [x, y, w, h] in device pixels from the lower left, project, eye, centre, lamp}. */
  draw(views, look) {
    const gl = this.gl;
    gl.enable(gl.DEPTH_TEST); gl.enable(gl.SCISSOR_TEST);
    gl.disable(gl.SCISSOR_TEST); gl.clearColor(0, 0, 0, 0); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT); gl.enable(gl.SCISSOR_TEST);
    views.forEach(view => this.drawView(view, this.models.get(view.figure), look));
  }

  drawView(view, model, look) {
    const gl = this.gl, { figure, box, centre, lamp } = view;
    const light = lightMatrix(add(centre, [0, 0.5 * figure.stature, 0]), lamp, 0.85 * figure.stature);
    gl.activeTexture(gl.TEXTURE0); gl.bindTexture(gl.TEXTURE_2D, model.texture);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, figure.count * 3, 1, gl.RGBA, gl.FLOAT, figure.mats);
    gl.activeTexture(gl.TEXTURE1); gl.bindTexture(gl.TEXTURE_2D, null);
    // the lamp's view, for the shadow
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadow.buffer);
    gl.viewport(0, 0, this.shadow.size, this.shadow.size); gl.scissor(0, 0, this.shadow.size, this.shadow.size);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    this.use(this.caster, { joints: 0, project: light, tones: figure.tones });
    gl.enable(gl.POLYGON_OFFSET_FILL); gl.polygonOffset(1.5, 3);
    this.drawMesh(model);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    // the camera's view
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(...box); gl.scissor(...box);
    gl.bindTexture(gl.TEXTURE_2D, this.shadow.texture);
    const shared = { project: view.project, eye: view.eye, shadowMap: 1, lightProject: light, dark: look.dark };
    this.use(this.body, { ...shared, joints: 0, tones: figure.tones, lamp, floorHeight: figure.floor });
    gl.enable(gl.CULL_FACE); gl.cullFace(gl.BACK);
    this.drawMesh(model);
    gl.disable(gl.CULL_FACE);
    gl.enable(gl.BLEND); gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.use(this.floor, { ...shared, centre, reach: 2.0 * figure.stature, lineColour: look.line, blobs: figure.contacts() });
    this.drawMesh(this.quad);
    gl.disable(gl.BLEND);
  }

  use(shader, values) {
    const gl = this.gl;
    gl.useProgram(shader.program);
    for (const [name, value] of Object.entries(values)) {
      const at = shader.at(name);
      if (name === "joints" || name === "shadowMap") gl.uniform1i(at, value);
      else if (typeof value === "number") gl.uniform1f(at, value);
      else if (name === "blobs") gl.uniform4fv(at, value);
      else if (value.length === 16) gl.uniformMatrix4fv(at, false, value);
      else gl.uniform3fv(at, value);
    }
  }

  drawMesh(mesh) { const gl = this.gl; gl.bindVertexArray(mesh.vao); gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_INT, 0); }
}

// Matrices, column after column as WebGL wants them
function lookAt(eye, target) {
  const back = unit(add(eye, target, -1)), right = unit(cross(Math.abs(back[1]) > 0.999 ? [0, 0, 1] : [0, 1, 0], back)), up = cross(back, right);
  return [right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0, -dot(right, eye), -dot(up, eye), -dot(back, eye), 1];
}
function times(a, b) {
  const out = new Array(16).fill(0);
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) for (let k = 0; k < 4; k++) out[c * 4 + r] += a[k * 4 + r] * b[c * 4 + k];
  return out;
}
function perspective(tangent, aspect, near, far) {
  return [1 / (tangent * aspect), 0, 0, 0, 0, 1 / tangent, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0];
}
function lightMatrix(centre, lamp, radius) {
  const box = [1 / radius, 0, 0, 0, 0, 1 / radius, 0, 0, 0, 0, -1 / (2 * radius), 0, 0, 0, 0, 1];
  return times(box, lookAt(add(centre, lamp, 1e-3), centre));
}
