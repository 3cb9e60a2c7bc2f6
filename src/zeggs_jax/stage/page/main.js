// ---------------------------------------------------------------- the page: clock, sound, camera, layout, controls

const $ = id => document.getElementById(id);
const root = document.documentElement, scene = JSON.parse($("scene").textContent);

async function loadFigures() {
  return Promise.all(scene.figures.map(async data => {
    const [turns, moves] = await Promise.all([unpack(data.turns, data.parents.length * 4), unpack(data.moves, data.moving.length * 3)]);
    const figure = new Figure(data, turns, moves);
    dressed(figure);
    return figure;
  }));
}

/** A 16-bit mono WAV file of unpacked samples, as something an <audio> can play. */
async function loadTrack({ samples, rate }) {
  const pcm = await unpack(samples, 1), head = new DataView(new ArrayBuffer(44));
  const text = (at, word) => [...word].forEach((c, i) => head.setUint8(at + i, c.charCodeAt(0)));
  text(0, "RIFF"); head.setUint32(4, 36 + pcm.byteLength, true); text(8, "WAVEfmt "); head.setUint32(16, 16, true);
  head.setUint16(20, 1, true); head.setUint16(22, 1, true); head.setUint32(24, rate, true); head.setUint32(28, rate * 2, true);
  head.setUint16(32, 2, true); head.setUint16(34, 16, true); text(36, "data"); head.setUint32(40, pcm.byteLength, true);
  const audio = new Audio(URL.createObjectURL(new Blob([head, pcm], { type: "audio/wav" })));
  audio.preload = "auto";
  return { audio, pcm, rate, seconds: pcm.length / rate };
}

// ---------------------------------------------------------------- clock: the sound leads, the picture follows

class Clock {
  constructor(duration) { Object.assign(this, { duration, time: 0, speed: 1, playing: false, loop: false, muted: false, track: null, last: 0, waited: 0 }); }

  get sounding() { return this.track !== null && this.time < this.track.seconds - 0.02; }

  choose(track) {
    if (this.track && this.track !== track) this.track.audio.pause();
    this.track = track;
    this.join();
  }

  /** Puts the sound where the clock is. A browser that forbids it leaves the wall clock to lead until the next click. */
  join() {
    const audio = this.track?.audio;
    if (!audio) return;
    audio.playbackRate = this.speed; audio.muted = this.muted;
    if (Math.abs(audio.currentTime - this.time) > 0.02) audio.currentTime = Math.min(this.time, this.track.seconds);
    if (!this.playing || !this.sounding) return audio.pause();
    this.blocked = false;
    audio.play().catch(error => { this.blocked = error.name === "NotAllowedError"; });
  }

  play() {
    if (this.time >= this.duration - 1e-3) this.time = 0;
    this.playing = true; this.last = performance.now();
    this.join(); changed();
  }

  pause() { this.playing = false; this.track?.audio.pause(); changed(); }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    if (this.track) this.track.audio.currentTime = Math.min(this.time, this.track.seconds);
    this.join();
  }

  /** Once a screen frame: own time runs on smoothly and is drawn to the sound's; a gap over 0.1 s is closed at once. */
  tick() {
    const now = performance.now(), passed = (now - this.last) / 1000;
    this.last = now;
    if (!this.playing) return;
    const audio = this.track?.audio;
    const led = audio && this.sounding && !this.blocked && !audio.paused;
    const waiting = led && (audio.seeking || audio.readyState < 3);
    this.waited = waiting ? this.waited + passed : 0;
    if (!(waiting && this.waited < 2)) this.time += (led ? passed : Math.min(passed, 1)) * this.speed;
    if (led && !waiting) {
      const gap = audio.currentTime - this.time;
      this.time += Math.abs(gap) > 0.1 ? gap : gap * Math.min(1, passed * 5);
    }
    if (this.time < this.duration) return;
    if (this.loop) this.seek(0); else { this.time = this.duration; this.pause(); }
  }
}

// ---------------------------------------------------------------- start

let changed = () => {};

async function main() {
  const [figures, tracks] = await Promise.all([loadFigures(), Promise.all(scene.tracks.map(loadTrack))]);
  const clock = new Clock(Math.max(...figures.map(f => f.duration), ...tracks.map(t => t.seconds)));
  const roomOf = some => ({ tall: Math.max(...some.map(f => f.tall)), wide: Math.max(...some.map(f => f.wide)) });
  const room = roomOf(figures);
  const look = { dark: 0, line: [0, 0, 0] }, scheme = matchMedia("(prefers-color-scheme: dark)");
  const groups = [...new Set(figures.map(f => f.group))], spoken = new Spoken($("words"));
  let dirty = true, cells = [], drawn = "", shown = [...figures.keys()], heard = -1, canvas = $("canvas"), renderer;
  const redraw = () => { dirty = true; };
  const restyle = () => { look.dark = scheme.matches ? 1 : 0; look.line = scheme.matches ? [0.9, 0.9, 1] : [0.1, 0.1, 0.15]; drawWave(); redraw(); };

  const views = figures.map((figure, i) => {
    const view = $("views").appendChild(document.createElement("div"));
    view.className = "view";
    const label = view.appendChild(document.createElement("div"));
    label.className = "label"; label.hidden = !figure.label;
    label.append(Object.assign(document.createElement("i"), { style: `background:${figure.colour}` }), Object.assign(document.createElement("span"), { textContent: figure.label }));
    view.appendChild(Object.assign(document.createElement("div"), { className: "cue", hidden: !figure.cues.length }));
    return view;
  });
  const hear = i => {
    if (figures[i].track === null) return;
    heard = i;
    clock.choose(tracks[figures[i].track]);
    spoken.choose(figures[i].words);
    if (tracks.length > 1) views.forEach((view, k) => view.classList.toggle("heard", figures[k].track === figures[i].track));
    drawWave();
  };
  const choose = group => {                              // the figures of one tab
    shown = [...figures.keys()].filter(i => figures[i].group === group);
    views.forEach((view, i) => { view.hidden = !shown.includes(i); });
    Object.assign(room, roomOf(shown.map(i => figures[i])));
    const voiced = shown.includes(heard) ? heard : shown.find(i => figures[i].track !== null);
    if (voiced === undefined) { clock.choose(null); spoken.choose(figures[shown[0]].words); }
    else hear(voiced);
    layout();
  };

  function pickRenderer() {
    [canvas, renderer] = rendererOf(canvas, figures);
    canvas.addEventListener("webglcontextlost", event => { event.preventDefault(); renderer = null; });
    canvas.addEventListener("webglcontextrestored", () => { pickRenderer(); redraw(); });
    steer(canvas);
  }

  function layout() {
    const { clientWidth: width, clientHeight: height } = $("stage"), columns = columnsFor(shown.length, width, height);
    $("views").style.gridTemplateColumns = `repeat(${columns}, minmax(0, 1fr))`;
    $("views").style.gridAutoRows = "minmax(0, 1fr)";
    cells = shown.map(i => views[i]).map(v => ({ x: v.offsetLeft, y: v.offsetTop, w: v.offsetWidth, h: v.offsetHeight }));
    drawWave(); redraw();
  }

  let fine = 1, pace = 16, before = 0;                   // a slow machine gets a coarser picture, not a slower one
  function frame(now) {
    if (clock.playing) {
      pace += (Math.min(now - before, 500) - pace) * 0.15;
      if (pace > 45 && fine > 0.5) { fine = Math.max(fine * 0.8, 0.5); pace = 30; }
    }
    before = now;
    clock.tick();
    const state = clock.time.toFixed(4);
    if ((dirty || state !== drawn) && renderer && cells.length) {
      const scale = Math.min(devicePixelRatio || 1, 2) * (clock.playing ? fine : 1), [w, h] = [canvas.clientWidth, canvas.clientHeight].map(v => Math.round(v * scale));
      if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
      const seen = shown.map(i => figures[i]);
      seen.forEach(figure => figure.pose(clock.time));
      renderer.draw(seen.map((figure, i) => viewOf(figure, room, cells[i], scale, canvas, clock.time)), look);
      showTime();
      dirty = false; drawn = state;
      root.dataset.ready = renderer.name;
    }
    requestAnimationFrame(frame);
  }

  // -------------------------------------------------------------- time line

  const spell = t => `${Math.floor(t / 60)}:${String(Math.floor(t % 60)).padStart(2, "0")}`;
  function showTime() {
    const tenth = Math.floor(clock.time * 10 + 1e-6) / 10;
    $("time").textContent = `${spell(tenth)}.${Math.round(tenth * 10) % 10}`;
    $("seek").value = clock.time;
    $("seek").setAttribute("aria-valuetext", `${clock.time.toFixed(1)} of ${clock.duration.toFixed(1)} seconds`);
    spoken.show(clock.time);
    shown.forEach(i => { if (figures[i].cues.length) views[i].lastChild.textContent = cueAt(figures[i].cues, clock.time); });
    drawWave();
  }
  let bars = null;
  function drawWave() {
    const wave = $("wave"), scale = devicePixelRatio || 1, w = Math.round(wave.clientWidth * scale), h = Math.round(wave.clientHeight * scale);
    if (!w) return;
    if (wave.width !== w || wave.height !== h || bars?.track !== clock.track) {
      wave.width = w; wave.height = h;
      bars = loudness(clock.track, clock.duration, Math.max(1, Math.floor(w / (3 * scale))));
    }
    const context = wave.getContext("2d"), style = getComputedStyle(root), done = clock.time / clock.duration;
    context.clearRect(0, 0, w, h);
    bars.forEach((bar, i) => {
      context.fillStyle = style.getPropertyValue((i + 0.5) / bars.length < done ? "--accent" : "--quiet");
      context.globalAlpha = (i + 0.5) / bars.length < done ? 1 : 0.45;
      const tall = Math.max(2 * scale, bar * (h - 6 * scale));
      context.fillRect(i * w / bars.length, (h - tall) / 2, 2 * scale, tall);
    });
    context.globalAlpha = 1; context.fillStyle = style.getPropertyValue("--ink");
    for (const [from] of shown.flatMap(i => figures[i].cues.slice(1))) context.fillRect(from / clock.duration * w, 0, scale, h);
    context.fillStyle = style.getPropertyValue("--accent");
    context.fillRect(Math.min(done * w, w - 2 * scale) - scale / 2, 2 * scale, 2 * scale, h - 4 * scale);
  }

  // -------------------------------------------------------------- controls

  changed = () => {
    document.body.classList.toggle("playing", clock.playing);
    document.body.classList.toggle("muted", clock.muted);
    for (const button of [$("play"), $("start")]) button.setAttribute("aria-label", clock.playing ? "Pause" : "Play");
    $("loop").setAttribute("aria-pressed", clock.loop); $("mute").setAttribute("aria-pressed", clock.muted);
    redraw();
  };
  const toggle = () => { document.body.dataset.touched = ""; if (clock.playing) clock.pause(); else clock.play(); };
  const reset = () => { Object.assign(camera, camera.home); redraw(); };
  const repeat = () => { clock.loop = !clock.loop; changed(); };
  const mute = () => { clock.muted = !clock.muted; if (clock.track) clock.track.audio.muted = clock.muted; changed(); };
  const zoom = factor => { camera.zoom = Math.min(Math.max(camera.zoom * factor, 0.5), 6); redraw(); };
  const turn = (yaw, pitch) => { camera.yaw += yaw; camera.pitch = Math.min(Math.max(camera.pitch + pitch, -0.35), 1.5); redraw(); };
  const seek = time => { document.body.dataset.touched = ""; clock.seek(time); showTime(); redraw(); };
  for (const [id, act] of Object.entries({ play: toggle, start: toggle, loop: repeat, mute, reset })) $(id).onclick = act;
  $("seek").max = clock.duration; $("seek").step = "any";
  $("seek").oninput = () => seek(+$("seek").value);
  $("speed").onchange = () => { clock.speed = +$("speed").value; if (clock.track) clock.track.audio.playbackRate = clock.speed; };
  $("length").textContent = spell(clock.duration);
  document.body.classList.toggle("silent", !tracks.length);

  addEventListener("keydown", event => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    const step = figures[0].frameTime, onButton = event.target.tagName === "BUTTON";
    const keys = event.shiftKey && event.target.id !== "seek"
      ? { ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, 0.08), ArrowDown: () => turn(0, -0.08), "+": () => zoom(1.1) }
      : { ArrowLeft: () => seek(clock.time - 1), ArrowRight: () => seek(clock.time + 1), Home: () => seek(0), End: () => seek(clock.duration),
          ",": () => seek(clock.time - step), ".": () => seek(clock.time + step), "+": () => zoom(1.1), "=": () => zoom(1.1), "-": () => zoom(1 / 1.1),
          l: repeat, m: mute, r: reset, ...(onButton ? {} : { " ": toggle }) };
    const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (act) { event.preventDefault(); act(); }
  });
  addEventListener("pointerdown", () => { if (clock.playing && clock.blocked) clock.join(); });

  function steer(canvas) {
    const held = new Map();
    let moved = 0;
    canvas.onpointerdown = event => { canvas.setPointerCapture(event.pointerId); held.set(event.pointerId, [event.clientX, event.clientY]); moved = 0; };
    canvas.onpointermove = event => {
      const was = held.get(event.pointerId);
      if (!was) return;
      const is = [event.clientX, event.clientY], gap = () => { const [a, b] = [...held.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
      const before = held.size === 2 ? gap() : 0;
      held.set(event.pointerId, is);
      moved += Math.hypot(is[0] - was[0], is[1] - was[1]);
      if (held.size === 2) zoom(gap() / Math.max(before, 1)); else turn(-(is[0] - was[0]) * 0.008, (is[1] - was[1]) * 0.006);
    };
    canvas.onpointerup = canvas.onpointercancel = event => {
      held.delete(event.pointerId);
      if (event.type === "pointerup" && moved < 4) {
        const i = shown[cells.findIndex(c => event.offsetX >= c.x && event.offsetX < c.x + c.w && event.offsetY >= c.y && event.offsetY < c.y + c.h)];
        if (i >= 0 && tracks.length > 1 && tracks[figures[i].track] !== clock.track) hear(i); else toggle();
      }
    };
    canvas.onwheel = event => { event.preventDefault(); zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.04 : 0.0014))); };
    canvas.ondblclick = reset;
  }

  pickRenderer();
  makeTabs($("tabs"), groups, choose)();
  new ResizeObserver(layout).observe($("stage"));
  scheme.addEventListener("change", restyle);
  layout(); restyle(); changed();
  requestAnimationFrame(frame);
  if (scene.playing) { repeat(); toggle(); }            // goes on where another page was taken away

  window.player = {
    figures, tracks, camera, clock,
    get duration() { return clock.duration; }, get time() { return clock.time; }, get playing() { return clock.playing; },
    get renderer() { return renderer?.name; }, get frame() { return figures[0].frameAt(clock.time); },
    play: () => clock.play(), pause: () => clock.pause(), seek, redraw,
  };
}

/** How loud the sound is in each of `count` bars, 0 to 1; flat without sound. */
function loudness(track, duration, count) {
  const bars = new Array(count).fill(0);
  bars.track = track;
  if (!track) return bars;
  for (let i = 0; i < count; i++) {
    const from = Math.floor(i / count * duration * track.rate), to = Math.min(Math.floor((i + 1) / count * duration * track.rate), track.pcm.length);
    let sum = 0;
    for (let k = from; k < to; k += 4) sum += track.pcm[k] ** 2;
    bars[i] = to > from ? Math.sqrt(4 * sum / (to - from)) : 0;
  }
  const top = Math.max(...bars, 1);
  bars.forEach((bar, i) => { bars[i] = Math.sqrt(bar / top); });
  return bars;
}

main().catch(error => { root.dataset.ready = "failed"; $("hint").textContent = `This page could not start: ${error.message}`; throw error; });
