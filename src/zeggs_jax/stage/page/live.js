// ---------------------------------------------------------------- the live page: frames from a socket, sound to it

const $ = id => document.getElementById(id);
const root = document.documentElement, scene = JSON.parse($("scene").textContent);
const HELD = 0.1;                                        // s that frames are held back, so that a late one is still in time
const KEPT = 240;                                        // frames that are remembered, at most

/** A figure that is told its frames: {frame, place in the stream's unit, turns [J][4]}. */
class LiveFigure extends Figure {
  constructor(data) {
    super({ ...data, frames: 1 }, null, null);
    this.told = [];
    this.time = 0;                                       // of the frame that is shown, in the stream
    this.eyes = [0, 0];
    this.tall = 1.12 * this.stature; this.wide = 0.45 * this.stature;
    this.set(data, data, 0);
  }

  trackCentre() {}                                       // the camera follows what is shown, see `follow`

  hear(frame) {
    const newest = this.told[this.told.length - 1];
    if (newest && frame.frame <= newest.frame) this.told = [];   // another stream
    this.told.push(frame);
    if (this.told.length > KEPT) this.told.shift();
  }

  /** The moment `passed` seconds on: a little behind the newest frame, faster or slower to stay there; true if it moved. */
  advance(passed) {
    if (!this.told.length) return false;
    const newest = this.told[this.told.length - 1].time, want = newest - HELD, before = this.time;
    this.time += passed + (want - this.time) * Math.min(1, 2 * passed);
    if (Math.abs(want - this.time) > 0.5) this.time = want;
    this.time = Math.min(this.time, newest);
    if (this.time === before) return false;
    let i = this.told.findLastIndex(frame => frame.time <= this.time);
    if (i < 0) i = 0;
    const from = this.told[i], to = this.told[Math.min(i + 1, this.told.length - 1)];
    const span = to.time - from.time;
    this.set(from, to, span > 0 ? Math.min(Math.max((this.time - from.time) / span, 0), 1) : 0);
    const ease = Math.min(1, passed);                    // the camera takes about a second
    this.eyes = this.eyes.map((at, a) => at + (this.place[this.centre * 3 + 2 * a] - at) * ease);
    return true;
  }

  /** Between two frames. */
  set(from, to, share) {
    for (let a = 0; a < 3; a++) this.local[a] = this.unit * (from.place[a] * (1 - share) + to.place[a] * share);
    for (let j = 0; j < this.count; j++) {
      const p = from.turns[j], q = to.turns[j], near = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3];
      for (let a = 0; a < 4; a++) this.turn[j * 4 + a] = p[a] * (1 - share) + q[a] * (near < 0 ? -share : share);
    }
    this.carry();
  }

  follow() { return this.eyes; }
}

// ---------------------------------------------------------------- sound of this page: a microphone or a recording, as 16 bits

const CAPTURE = `registerProcessor("capture", class extends AudioWorkletProcessor {
  process([input]) { if (input.length) this.port.postMessage(input[0].slice()); return true; }
});`;

class Voice {
  constructor(send) { Object.assign(this, { send, context: null, stop: () => {} }); }

  /** Sends what a node plays from now on, in pieces of about 20 ms. */
  async capture(make) {
    this.end();
    const context = this.context = new AudioContext();
    await context.audioWorklet.addModule(URL.createObjectURL(new Blob([CAPTURE], { type: "text/javascript" })));
    const tap = new AudioWorkletNode(context, "capture", { channelCount: 1, channelCountMode: "explicit", numberOfOutputs: 0 });
    this.send(JSON.stringify({ rate: context.sampleRate }));
    let waiting = [], held = 0;
    tap.port.onmessage = ({ data }) => {
      waiting.push(data); held += data.length;
      if (held < 0.02 * context.sampleRate) return;
      const out = new Int16Array(held);
      let at = 0, top = 0;
      for (const piece of waiting) for (const x of piece) { top = Math.max(top, Math.abs(x)); out[at++] = Math.max(-32768, Math.min(32767, Math.round(x * 32767))); }
      waiting = []; held = 0;
      $("level").firstElementChild.style.width = `${100 * Math.min(1, Math.sqrt(top))}%`;
      this.send(out.buffer);
    };
    (await make(context)).connect(tap);
    $("level").hidden = false;
  }

  microphone() {
    return this.capture(async context => {
      const media = await navigator.mediaDevices.getUserMedia({ audio: { echoCancellation: false } });
      this.stop = () => media.getTracks().forEach(track => track.stop());
      return context.createMediaStreamSource(media);
    });
  }

  recording(bytes) {
    return this.capture(async context => {
      const source = context.createBufferSource();
      source.buffer = await context.decodeAudioData(bytes);
      source.connect(context.destination);
      source.onended = () => this.end();
      source.start();
      return source;
    });
  }

  end() {
    this.stop(); this.stop = () => {};
    this.context?.close(); this.context = null;
    $("level").hidden = true; $("speak").setAttribute("aria-pressed", "false");
  }
}

// ---------------------------------------------------------------- start

function main() {
  const figure = dressed(new LiveFigure(scene)), room = { tall: figure.tall, wide: figure.wide };
  const look = { dark: 0, line: [0, 0, 0] }, scheme = matchMedia("(prefers-color-scheme: dark)");
  const state = { open: false, frames: 0, dropped: 0, latency: 0, last: 0, told: performance.now() };
  let canvas = $("canvas"), renderer, dirty = true, socket = null, before = performance.now();
  const redraw = () => { dirty = true; }, say = text => { $("said").textContent = text; };

  // -------------------------------------------------------------- socket

  const send = data => { if (socket?.readyState === 1 && socket.bufferedAmount < 1 << 20) socket.send(data); };
  const voice = new Voice(send);
  const hear = {
    joints: told => { state.latency = told.latency[1]; state.dropped = 0; },
    frame: told => { figure.hear(told); state.frames++; },
    style: told => { $("style").value = told.style; if (told.at !== undefined) say(`turning to ${told.style}`); },
    dropped: told => { state.dropped += told.dropped; },
    note: told => say(told.note),
    end: () => say("the stream has ended"),
  };
  function connect() {
    socket = new WebSocket(`ws://${location.host || "127.0.0.1:8765"}/`);
    socket.onopen = () => { state.open = true; };
    socket.onmessage = ({ data }) => {
      const told = JSON.parse(data);
      for (const kind of Object.keys(hear)) if (kind in told) return hear[kind](told);
    };
    socket.onclose = () => { state.open = false; voice.end(); setTimeout(connect, 1000); };
  }

  // -------------------------------------------------------------- picture

  function pickRenderer() {
    [canvas, renderer] = rendererOf(canvas, [figure]);
    canvas.addEventListener("webglcontextlost", event => { event.preventDefault(); renderer = null; });
    canvas.addEventListener("webglcontextrestored", () => { pickRenderer(); redraw(); });
    steer();
  }
  let fine = 1, pace = 16;                               // a slow machine gets a coarser picture, not a slower one
  function frame(now) {
    const passed = Math.min((now - before) / 1000, 1);
    before = now;
    pace += (Math.min(1000 * passed, 500) - pace) * 0.15;
    if (pace > 45 && fine > 0.3) { fine = Math.max(fine * 0.8, 0.3); pace = 30; }
    if ((figure.advance(passed) || dirty) && renderer && canvas.clientWidth) {
      const scale = fine * Math.min(devicePixelRatio || 1, 2), [w, h] = [canvas.clientWidth, canvas.clientHeight].map(v => Math.round(v * scale));
      if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
      const cell = { x: 0, y: 0, w: canvas.clientWidth, h: canvas.clientHeight };
      renderer.draw([viewOf(figure, room, cell, scale, canvas, 0)], look);
      dirty = false;
      root.dataset.ready = renderer.name;
    }
    requestAnimationFrame(frame);
  }
  function tell() {                                      // the figures, about once a second
    const now = performance.now(), pace = (state.frames - state.last) * 1000 / (now - state.told);
    state.last = state.frames; state.told = now;
    document.body.classList.toggle("live", state.open && pace > 0);
    const figures = [pace ? `live · ${Math.round(pace)} frames a second` : "waiting for speech",
      `${Math.round((state.latency + HELD) * 1000)} ms behind the voice`, `${state.dropped} left out`];
    $("state").lastElementChild.textContent = state.open ? figures.join(" · ") : "not connected";
  }

  // -------------------------------------------------------------- controls

  const zoom = factor => { camera.zoom = Math.min(Math.max(camera.zoom * factor, 0.5), 6); redraw(); };
  const turn = (yaw, pitch) => { camera.yaw += yaw; camera.pitch = Math.min(Math.max(camera.pitch + pitch, -0.35), 1.5); redraw(); };
  const reset = () => { Object.assign(camera, camera.home); redraw(); };
  function steer() {
    let at = null;
    canvas.onpointerdown = event => { canvas.setPointerCapture(event.pointerId); at = [event.clientX, event.clientY]; };
    canvas.onpointermove = event => {
      if (!at) return;
      turn(-(event.clientX - at[0]) * 0.008, (event.clientY - at[1]) * 0.006);
      at = [event.clientX, event.clientY];
    };
    canvas.onpointerup = canvas.onpointercancel = () => { at = null; };
    canvas.onwheel = event => { event.preventDefault(); zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.04 : 0.0014))); };
    canvas.ondblclick = reset;
  }
  addEventListener("keydown", event => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    const keys = { "+": () => zoom(1.1), "=": () => zoom(1.1), "-": () => zoom(1 / 1.1), r: reset,
      ...(event.shiftKey ? { ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, 0.08), ArrowDown: () => turn(0, -0.08) } : {}) };
    const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (act) { event.preventDefault(); act(); }
  });
  const failed = error => { voice.end(); say(`no sound: ${error.message}`); };
  $("reset").onclick = reset;
  $("speak").onclick = () => {
    if ($("speak").getAttribute("aria-pressed") === "true") return voice.end();
    voice.microphone().then(() => $("speak").setAttribute("aria-pressed", "true"), failed);
  };
  $("choose").onclick = () => $("file").click();
  $("file").onchange = async () => { const [file] = $("file").files; if (file) voice.recording(await file.arrayBuffer()).catch(failed); };
  const styles = scene.styles.includes(scene.style) ? scene.styles : [scene.style, ...scene.styles];
  $("style").append(...styles.map(name => new Option(name, name, false, name === scene.style)));
  $("style").onchange = () => send(JSON.stringify({ style: $("style").value }));

  const restyle = () => { look.dark = scheme.matches ? 1 : 0; look.line = scheme.matches ? [0.9, 0.9, 1] : [0.1, 0.1, 0.15]; redraw(); };
  scheme.addEventListener("change", restyle);
  new ResizeObserver(redraw).observe($("stage"));
  pickRenderer(); restyle(); connect();
  setInterval(tell, 1000);
  requestAnimationFrame(frame);
  window.live = { figure, camera, state, voice, send };
}

main();
