// Draws the points that animation.py computed: projection, time and mouse, no kinematics.
(() => {
  "use strict";
  const data = JSON.parse(document.getElementById("robot-data").textContent);
  const canvas = document.getElementById("robot-canvas"), pen = canvas.getContext("2d");
  const play = document.getElementById("robot-play"), slider = document.getElementById("robot-slider");
  const clock = document.getElementById("robot-time"), speed = document.getElementById("robot-speed");
  const frames = data.time.length, MISSING = -32768;

  // points as [x, y, z] in metres, NaN where nothing is known
  const unpack = (text, points) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0)), view = new DataView(bytes.buffer);
    const at = (i) => {
      const steps = view.getInt16(2 * i, true);
      return steps === MISSING ? NaN : data.middle[i % 3] + steps * data.step;
    };
    const count = bytes.length / (6 * points);
    return (frame) => {
      const from = 3 * points * Math.min(frame, count - 1);
      return Array.from({length: points}, (_, p) => [at(from + 3 * p), at(from + 3 * p + 1), at(from + 3 * p + 2)]);
    };
  };
  const tracks = Object.fromEntries(Object.entries(data.tracks).map(([name, t]) => [name, unpack(t, data.points)]));
  const triads = data.frames.map((text) => unpack(text, 4)), marks = data.marks.map((text) => unpack(text, 1));

  // ---- view: degrees about the vertical and above the horizon, orthographic
  let [azimuth, elevation] = data.view, frame = 0;
  let width = 1, height = 1, scale = 1, right, up, centre;
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const project = (p) => {
    const q = [p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]];
    return [width / 2 + scale * dot(right, q), height / 2 - scale * dot(up, q)];
  };
  // a robot that goes far is followed
  const far = Math.max(...[0, 1, 2].map((k) => data.high[k] - data.low[k])) > 12 * data.size;
  const aim = () => {
    const a = azimuth * Math.PI / 180, e = elevation * Math.PI / 180;
    right = [Math.cos(a), Math.sin(a), 0];
    up = [-Math.sin(e) * Math.sin(a), Math.sin(e) * Math.cos(a), Math.cos(e)];
    // the box of everything that is ever drawn fits the canvas
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((i) => [0, 1, 2].map((k) => (i >> k & 1 ? data.high : data.low)[k]));
    const extent = (axis) => {
      const along = corners.map((c) => dot(axis, c));
      return Math.max(...along) - Math.min(...along);
    };
    centre = data.middle;
    scale = Math.min(0.84 * width / Math.max(extent(right), 0.2 * data.size),
                     0.84 * height / Math.max(extent(up), 0.2 * data.size));
    if (far) {
      const points = tracks[tracks.truth ? "truth" : "estimate"](frame).filter((p) => isFinite(p[0] + p[1] + p[2]));
      if (points.length) centre = [0, 1, 2].map((k) => points.reduce((sum, p) => sum + p[k], 0) / points.length);
      scale = 0.3 * Math.min(width, height) / data.size;
    }
  };

  // ---- drawing
  const line = (points, closed) => {
    if (!points.every((p) => isFinite(p[0] + p[1] + p[2]))) return;
    pen.beginPath();
    points.map(project).forEach(([x, y], i) => i ? pen.lineTo(x, y) : pen.moveTo(x, y));
    if (closed) pen.closePath();
    pen.stroke();
  };
  const mix = (o, a, x, b, y) => [0, 1, 2].map((k) => o[k] + x * (a[k] - o[k]) + y * (b[k] - o[k]));
  const circle = ([o, a, b]) => Array.from({length: 33}, (_, i) =>
    mix(o, a, Math.cos(i * Math.PI / 16), b, Math.sin(i * Math.PI / 16)));
  const box = ([o, a, b, c]) => {
    const lift = (p) => [0, 1, 2].map((k) => p[k] + c[k] - o[k]);
    const face = [o, a, mix(o, a, 1, b, 1), b];
    line(face, true);
    line(face.map(lift), true);
    face.forEach((p) => line([p, lift(p)]));
  };
  const figure = (points, colour, thick, dash) => {
    pen.strokeStyle = pen.fillStyle = colour;
    pen.lineWidth = thick;
    pen.setLineDash(dash);
    for (const [kind, ...indices] of data.shapes) {
      const at = indices.map((i) => points[i]);
      if (kind === "line") line(at);
      if (kind === "circle") line(circle(at));
      if (kind === "box") box(at);
    }
    if (dash.length) return;
    for (const [kind, ...indices] of data.shapes) {  // joints
      for (const p of kind === "line" ? indices.map((i) => points[i]) : []) {
        const [x, y] = project(p);
        if (!isFinite(x + y)) continue;
        pen.beginPath();
        pen.arc(x, y, 0.85 * thick, 0, 2 * Math.PI);
        pen.fill();
      }
    }
  };
  const ground = () => {
    pen.strokeStyle = data.colours.ground;
    pen.lineWidth = 1;
    pen.setLineDash([]);
    const across = Math.max(data.high[0] - data.low[0], data.high[1] - data.low[1], data.size);
    const cell = Math.pow(10, Math.floor(Math.log10(across))) / (across / Math.pow(10,
      Math.floor(Math.log10(across))) < 4 ? 4 : 1);
    const from = [0, 1].map((k) => Math.floor((data.low[k] - 0.2 * across) / cell));
    const to = [0, 1].map((k) => Math.ceil((data.high[k] + 0.2 * across) / cell));
    for (let i = from[0]; i <= to[0]; ++i) line([[i * cell, from[1] * cell, 0], [i * cell, to[1] * cell, 0]]);
    for (let i = from[1]; i <= to[1]; ++i) line([[from[0] * cell, i * cell, 0], [to[0] * cell, i * cell, 0]]);
    return cell;
  };
  const compass = (cell) => {
    const at = [34, height - 30];
    pen.font = "12px system-ui, sans-serif";
    pen.setLineDash([]);
    pen.fillStyle = pen.strokeStyle = "#5a626b";
    pen.lineWidth = 1.5;
    [..."xyz"].forEach((name, k) => {
      const tip = [at[0] + 20 * right[k], at[1] - 20 * up[k]];
      if (Math.hypot(right[k], up[k]) < 0.15) return;
      pen.beginPath();
      pen.moveTo(...at);
      pen.lineTo(...tip);
      pen.stroke();
      pen.fillText(name, tip[0] + 6 * right[k] - 3, tip[1] - 6 * up[k] + 4);
    });
    const text = `grid ${+cell.toPrecision(2)} m, at z = 0`;
    pen.fillText(text, width - pen.measureText(text).width - 8, height - 8);
  };
  // where the figure's tip was
  const trace = () => {
    const track = tracks[tracks.truth ? "truth" : "estimate"];
    pen.strokeStyle = data.colours.trace;
    pen.lineWidth = 1.5;
    pen.setLineDash([]);
    pen.beginPath();
    let drawing = false;
    for (let i = 0; i <= frame; ++i) {
      const [x, y] = project(track(i)[data.tip]);
      if (isFinite(x + y)) drawing ? pen.lineTo(x, y) : pen.moveTo(x, y);
      drawing = isFinite(x + y);
    }
    pen.stroke();
  };
  const goals = () => {
    pen.setLineDash([]);
    pen.lineWidth = 2;
    for (const triad of triads) {
      const points = triad(frame);
      ["#b3261e", "#2e7d32", "#1f5fa8"].forEach((colour, k) => {
        pen.strokeStyle = colour;
        line([points[0], points[1 + k]]);
      });
    }
    pen.strokeStyle = data.colours.goal;
    for (const [p] of [...triads, ...marks].map((of) => of(frame))) {
      const [x, y] = project(p);
      if (!isFinite(x + y)) continue;
      pen.beginPath();
      pen.moveTo(x - 7, y);
      pen.lineTo(x + 7, y);
      pen.moveTo(x, y - 7);
      pen.lineTo(x, y + 7);
      pen.stroke();
    }
  };
  const draw = () => {
    aim();
    pen.clearRect(0, 0, width, height);
    pen.lineJoin = pen.lineCap = "round";
    const cell = ground();
    pen.fillStyle = data.colours.obstacle + "59";
    for (const obstacle of data.obstacles) {
      pen.beginPath();
      circle(obstacle).map(project).forEach(([x, y]) => pen.lineTo(x, y));
      pen.fill();
    }
    trace();
    if (tracks.goal) figure(tracks.goal(frame), data.colours.goal, 1.5, [1, 4]);
    goals();
    figure(tracks.estimate(frame), data.colours.estimate, 4, []);
    if (tracks.truth) figure(tracks.truth(frame), data.colours.truth, 2, [7, 6]);
    compass(cell);
  };
  const show = (wanted) => {
    frame = Math.max(0, Math.min(frames - 1, wanted));
    slider.value = frame;
    clock.textContent = data.time[frame].toFixed(2) + " s";
    slider.setAttribute("aria-valuetext", clock.textContent);
    draw();
  };

  // ---- time
  let running = false, shown = 0, last = 0;
  const step = (now) => {
    if (!running) return;
    shown += (now - last) / 1000 * Number(speed.value);
    last = now;
    let next = frame;
    while (next + 1 < frames && data.time[next + 1] <= shown) ++next;
    if (next !== frame) show(next);
    frame === frames - 1 ? pause() : requestAnimationFrame(step);
  };
  const pause = () => {
    running = false;
    play.textContent = "Play";
  };
  const start = () => {
    if (frame === frames - 1) show(0);
    running = true;
    shown = data.time[frame];
    last = performance.now();
    play.textContent = "Pause";
    requestAnimationFrame(step);
  };
  play.addEventListener("click", () => running ? pause() : start());
  slider.addEventListener("input", () => {
    pause();
    show(Number(slider.value));
  });

  // ---- mouse and finger
  let held = null;
  canvas.addEventListener("pointerdown", (event) => {
    held = [event.clientX, event.clientY];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!held) return;
    azimuth -= 0.5 * (event.clientX - held[0]);
    elevation = Math.max(-90, Math.min(90, elevation + 0.5 * (event.clientY - held[1])));
    held = [event.clientX, event.clientY];
    draw();
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => held = null);
  canvas.addEventListener("dblclick", () => {
    [azimuth, elevation] = data.view;
    draw();
  });

  const fit = () => {
    const sharp = window.devicePixelRatio || 1;
    width = canvas.clientWidth;
    height = canvas.clientHeight;
    canvas.width = Math.round(sharp * width);
    canvas.height = Math.round(sharp * height);
    pen.setTransform(sharp, 0, 0, sharp, 0, 0);
    draw();
  };
  new ResizeObserver(fit).observe(canvas);
  fit();
  show(0);

  // once, when it comes into sight
  if (!matchMedia("(prefers-reduced-motion: reduce)").matches) {
    const seen = new IntersectionObserver((entries) => {
      if (!entries.some((entry) => entry.isIntersecting)) return;
      seen.disconnect();
      start();
    }, {threshold: 0.6});
    seen.observe(canvas);
  }
})();
