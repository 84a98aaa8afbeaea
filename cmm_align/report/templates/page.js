// The map of the page: drawn from its nodes, read under the pointer, coloured as the slider says.
"use strict";
(() => {
  const byId = (id) => document.getElementById(id);
  const data = JSON.parse(byId("map-data").textContent);
  const canvas = byId("map"), bar = byId("bar"), slider = byId("range"), exact = byId("limit");
  const INK = "#1d2733", SOFT = "#55616d", RULE = "#c3cad1", GROUND = "#e9ecef", HATCH = "#a3adb7";
  const font = (px, weight = 400) =>
    `${weight} ${px}px system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif`;
  const MINUS = "\u2212";
  const nx = data.x_mm.length, ny = data.y_mm.length;

  // ---- the nodes ----
  const bytes = (text) => {
    const raw = atob(text), out = new Uint8Array(raw.length);
    for (let k = 0; k < raw.length; k++) out[k] = raw.charCodeAt(k);
    return out.buffer;
  };
  const counts = data.bits === 16 ? new Int16Array(bytes(data.deviation)) : new Int32Array(bytes(data.deviation));
  const uCounts = new Uint16Array(bytes(data.u));
  const UNKNOWN = -(2 ** (data.bits - 1)), UNKNOWN_U = 2 ** 16 - 1;
  const per = 10 ** data.digits;
  const x0 = data.x_mm[0], y0 = data.y_mm[0];
  const dx = nx > 1 ? (data.x_mm[nx - 1] - x0) / (nx - 1) : 1;
  const dy = ny > 1 ? (data.y_mm[ny - 1] - y0) / (ny - 1) : 1;
  const known = (ix, iy) => ix >= 0 && iy >= 0 && ix < nx && iy < ny && counts[iy * nx + ix] !== UNKNOWN;

  const pathOf = (rings) => {
    const path = new Path2D();
    for (const ring of rings) {
      for (let k = 0; k < ring.length; k += 2) path[k ? "lineTo" : "moveTo"](ring[k], ring[k + 1]);
      path.closePath();
    }
    return path;
  };
  const aperture = pathOf(data.outline_mm);
  const regions = data.regions.map((r) => ({ path: pathOf(r.outline_mm), dash: r.name === "fit region" ? [1, 3] : [7, 4] }));

  // One ring of nodes more than the file has; unknown ones take the mean of known neighbours, twice, so that
  // colours reach the border of the part. What is shown is decided by `drawn`, not by these means.
  const px = nx + 2, py = ny + 2;
  const value = new Float32Array(px * py), drawn = new Uint8Array(px * py);
  const prepare = () => {
    let have = new Uint8Array(px * py);
    for (let iy = 0; iy < ny; iy++) for (let ix = 0; ix < nx; ix++) {
      const k = (iy + 1) * px + ix + 1, count = counts[iy * nx + ix];
      if (count !== UNKNOWN) { value[k] = count / per; have[k] = drawn[k] = 1; }
    }
    const probe = document.createElement("canvas").getContext("2d");
    const outside = (ix, iy) => !probe.isPointInPath(aperture, x0 + (ix - 1) * dx, y0 + (iy - 1) * dy, "evenodd");
    for (let round = 0; round < 2; round++) {
      const next = have.slice();
      for (let iy = 0; iy < py; iy++) for (let ix = 0; ix < px; ix++) {
        const k = iy * px + ix;
        if (have[k]) continue;
        let sum = 0, n = 0;
        for (let ky = Math.max(iy - 1, 0); ky <= Math.min(iy + 1, py - 1); ky++)
          for (let kx = Math.max(ix - 1, 0); kx <= Math.min(ix + 1, px - 1); kx++)
            if (have[ky * px + kx]) { sum += value[ky * px + kx]; n++; }
        if (!n) continue;
        value[k] = sum / n;
        next[k] = 1;
        if (round === 0 && outside(ix, iy)) drawn[k] = 1;
      }
      have = next;
    }
  };
  prepare();

  const table = new Uint32Array(data.colours.length / 6);
  for (let k = 0; k < table.length; k++) {
    const c = parseInt(data.colours.slice(6 * k, 6 * k + 6), 16);
    table[k] = (255 << 24) | ((c & 255) << 16) | (c & 0xff00) | (c >> 16);
  }
  const css = (k) => "#" + data.colours.slice(6 * k, 6 * k + 6);

  // ---- numbers as text ----
  const signed = (v, digits) => {
    const text = Math.abs(v).toFixed(digits);
    return Number(text) === 0 ? text : (v < 0 ? MINUS : "+") + text;
  };
  const three = (v) => Number(v.toPrecision(3)).toString();

  // ---- where things lie ----
  const [bx0, bx1, by0, by1] = data.bounds_mm;
  const edge = 0.025 * Math.max(bx1 - bx0, by1 - by0);
  const world = { x: bx0 - edge, y: by0 - edge, w: bx1 - bx0 + 2 * edge, h: by1 - by0 + 2 * edge };
  const LEFT = 44, TOP = 10, RIGHT = 12, BOTTOM = 38;
  let limit = data.limit_um, chosen = null, place = null, field = null, ground = null;

  // On paper the map has a fixed room, finer pixels and smaller letters.
  const PAPER = { width: 690, height: 345, ratio: 3, letters: 9.5 };
  const layout = (paper = null) => {
    const wide = paper ? paper.width : canvas.parentElement.clientWidth;
    const tallest = paper ? paper.height - TOP - BOTTOM : Math.max(360, Math.min(620, 0.72 * window.innerHeight));
    const scale = Math.min(Math.max(wide - LEFT - RIGHT, 120) / world.w, tallest / world.h);
    const ratio = paper ? paper.ratio : Math.max(2, window.devicePixelRatio || 1);
    const w = world.w * scale, h = world.h * scale;
    place = { scale, ratio, w, h, width: w + LEFT + RIGHT, height: h + TOP + BOTTOM };
    place.letters = paper ? paper.letters : 12;
    place.bar = Math.min(wide, Math.max(place.width, 320));
    canvas.width = Math.round(place.width * ratio);
    canvas.height = Math.round(place.height * ratio);
    canvas.style.width = place.width + "px";
    canvas.style.height = place.height + "px";
    bar.parentElement.style.width = place.bar + "px";
    // The script's own account of where a node lies, in CSS pixels from the corner of the canvas.
    Object.assign(canvas.dataset, { left: LEFT, top: TOP, scale, x: world.x, y: world.y + world.h });
    sample();
  };
  const toX = (x) => LEFT + (x - world.x) * place.scale;
  const toY = (y) => TOP + (world.y + world.h - y) * place.scale;

  // Deviation under every pixel, NaN where nothing is drawn: between nodes a linear blend, on a coarse grid in
  // a seam only, so that nothing looks measured where nothing was.
  const sample = () => {
    const wide = Math.round(place.w * place.ratio), high = Math.round(place.h * place.ratio);
    const longest = Math.max(nx, ny), seam = longest >= 50 ? 1 : Math.max(0.6, longest / 50);
    const blend = (t) => Math.min(1, Math.max(0, (t - 0.5) / seam + 0.5));
    const first = new Int32Array(wide), weight = new Float32Array(wide), nearest = new Int32Array(wide);
    for (let i = 0; i < wide; i++) {
      const f = (world.x + (i + 0.5) / (place.scale * place.ratio) - x0) / dx + 1;
      first[i] = Math.floor(f);
      weight[i] = blend(f - first[i]);
      nearest[i] = Math.round(f);
    }
    field = { wide, high, um: new Float32Array(wide * high).fill(NaN) };
    for (let j = 0; j < high; j++) {
      const f = (world.y + world.h - (j + 0.5) / (place.scale * place.ratio) - y0) / dy + 1;
      const low = Math.floor(f), t = blend(f - low), near = Math.round(f);
      if (near < 0 || near >= py) continue;
      const a = Math.min(Math.max(low, 0), py - 1) * px, b = Math.min(Math.max(low + 1, 0), py - 1) * px;
      for (let i = 0; i < wide; i++) {
        if (nearest[i] < 0 || nearest[i] >= px || !drawn[near * px + nearest[i]]) continue;
        const l = Math.min(Math.max(first[i], 0), px - 1), r = Math.min(Math.max(first[i] + 1, 0), px - 1);
        const s = weight[i];
        field.um[j * wide + i] =
          (1 - t) * ((1 - s) * value[a + l] + s * value[a + r]) + t * ((1 - s) * value[b + l] + s * value[b + r]);
      }
    }
    colour();
  };

  const ticks = (low, high, most) => {
    const raw = (high - low) / most, unit = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((m) => m * unit).find((s) => s >= raw);
    const out = [];
    for (let k = Math.ceil(low / step); k * step <= high; k++) out.push(k * step);
    return { at: out, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
  };

  const hatch = (context) => {
    const tile = document.createElement("canvas");
    tile.width = tile.height = 12;
    const t = tile.getContext("2d");
    t.fillStyle = GROUND;
    t.fillRect(0, 0, 12, 12);
    t.strokeStyle = HATCH;
    t.lineWidth = 1.4;
    for (const c of [-12, 0, 12]) { t.beginPath(); t.moveTo(c - 1, 13); t.lineTo(c + 13, -1); t.stroke(); }
    return context.createPattern(tile, "repeat");
  };

  // Everything but the mark under the pointer.
  const colour = () => {
    const picture = document.createElement("canvas");
    picture.width = field.wide;
    picture.height = field.high;
    const p = picture.getContext("2d"), image = p.createImageData(field.wide, field.high);
    const pixels = new Uint32Array(image.data.buffer), last = table.length - 1, gain = (0.5 * last) / limit;
    for (let k = 0; k < pixels.length; k++) {
      const v = field.um[k];
      if (v === v) pixels[k] = table[Math.min(last, Math.max(0, Math.round(v * gain + 0.5 * last)))];
    }
    p.putImageData(image, 0, 0);
    ground = document.createElement("canvas");
    ground.width = canvas.width;
    ground.height = canvas.height;
    const g = ground.getContext("2d");
    const paper = () => g.setTransform(place.ratio, 0, 0, place.ratio, 0, 0);
    const part = () => {
      const s = place.ratio * place.scale;
      g.setTransform(s, 0, 0, -s, place.ratio * toX(0), place.ratio * toY(0));
    };
    const pattern = hatch(g);
    g.save();
    part();
    g.clip(aperture, "evenodd");
    g.setTransform(1, 0, 0, 1, 0, 0);
    g.fillStyle = pattern;
    g.fillRect(0, 0, ground.width, ground.height);
    g.drawImage(picture, LEFT * place.ratio, TOP * place.ratio);
    g.restore();
    part();
    g.strokeStyle = INK;
    g.lineWidth = 1 / place.scale;
    g.lineJoin = "round";
    g.stroke(aperture);
    g.lineWidth = 1.4 / place.scale;
    for (const region of regions) {
      g.setLineDash(region.dash.map((v) => v / place.scale));
      g.stroke(region.path);
    }
    g.setLineDash([]);
    paper();
    axes(g);
    for (const e of data.extremes) mark(g, e);
    drawBar();
    draw();
  };

  const axes = (g) => {
    const along = ticks(bx0, bx1, Math.max(2, Math.min(8, place.w / 70)));
    const up = ticks(by0, by1, Math.max(2, Math.min(8, place.h / 50)));
    const bottom = TOP + place.h;
    g.font = font(place.letters);
    g.fillStyle = SOFT;
    g.strokeStyle = RULE;
    g.lineWidth = 1;
    g.beginPath();
    g.moveTo(LEFT, TOP); g.lineTo(LEFT, bottom); g.lineTo(LEFT + place.w, bottom);
    for (const x of along.at) { g.moveTo(toX(x), bottom); g.lineTo(toX(x), bottom + 4); }
    for (const y of up.at) { g.moveTo(LEFT, toY(y)); g.lineTo(LEFT - 4, toY(y)); }
    g.stroke();
    g.textAlign = "center";
    g.textBaseline = "top";
    for (const x of along.at) g.fillText(signedPlain(x, along.digits), toX(x), bottom + 6);
    g.fillText("x, mm", LEFT + place.w / 2, bottom + 22);
    g.textAlign = "right";
    g.textBaseline = "middle";
    for (const y of up.at) g.fillText(signedPlain(y, up.digits), LEFT - 7, toY(y));
    g.save();
    g.translate(9, TOP + place.h / 2);
    g.rotate(-Math.PI / 2);
    g.textAlign = "center";
    g.fillText("y, mm", 0, 0);
    g.restore();
  };
  const signedPlain = (v, digits) => (v < 0 ? MINUS : "") + Math.abs(v).toFixed(digits);

  const mark = (g, e) => {
    const x = toX(e.x_mm), y = toY(e.y_mm), s = e.up ? -5 : 5;
    g.beginPath();
    g.moveTo(x, y + s); g.lineTo(x - 5, y - 0.8 * s); g.lineTo(x + 5, y - 0.8 * s); g.closePath();
    g.lineJoin = "round";
    g.lineWidth = 2.5;
    g.strokeStyle = "#fff";
    g.stroke();
    g.fillStyle = INK;
    g.fill();
    const text = `${e.name} ${e.sign}${e.um} \u00b5m`;
    g.font = font(place.letters, 600);
    const half = g.measureText(text).width / 2;
    const middle = Math.min(Math.max(x, LEFT + half + 4), LEFT + place.w - half - 4);
    const other = data.extremes.find((o) => o !== e);
    let side = y > toY(other.y_mm) ? 1 : -1; // away from the other mark, unless the border is there
    if (y < TOP + 44) side = 1;
    if (y > TOP + place.h - 44) side = -1;
    g.textAlign = "center";
    g.textBaseline = "middle";
    g.lineWidth = 3.5;
    g.strokeText(text, middle, y + 17 * side);
    g.fillText(text, middle, y + 17 * side);
  };

  const drawBar = () => {
    const w = place.bar, h = 40, ratio = place.ratio, inset = 34;
    bar.width = Math.round(w * ratio);
    bar.height = h * ratio;
    bar.style.width = w + "px";
    bar.style.height = h + "px";
    const b = bar.getContext("2d"), long = w - 2 * inset;
    b.setTransform(ratio, 0, 0, ratio, 0, 0);
    const blend = b.createLinearGradient(inset, 0, inset + long, 0);
    for (let k = 0; k < table.length; k += 2) blend.addColorStop(k / (table.length - 1), css(k));
    b.fillStyle = blend;
    b.fillRect(inset, 4, long, 12);
    b.strokeStyle = RULE;
    b.lineWidth = 1;
    b.strokeRect(inset, 4, long, 12);
    const at = (v) => inset + (long * (v / limit + 1)) / 2;
    const inner = ticks(-limit, limit, Math.max(2, Math.min(8, long / 70)));
    const step = inner.at.length > 1 ? inner.at[1] - inner.at[0] : limit;
    b.font = font(place.letters);
    b.fillStyle = SOFT;
    b.textAlign = "center";
    b.textBaseline = "top";
    const label = (v, text) => {
      b.fillText(text, at(v), 22);
      b.beginPath(); b.moveTo(at(v), 16); b.lineTo(at(v), 20); b.stroke();
    };
    for (const v of inner.at) if (Math.abs(v) <= limit - 0.6 * step) label(v, signed(v, inner.digits));
    label(-limit, MINUS + three(limit));
    label(limit, "+" + three(limit));
    if (chosen && chosen.um !== null) {
      const x = at(Math.max(-limit, Math.min(limit, chosen.um)));
      b.fillStyle = INK;
      b.beginPath(); b.moveTo(x, 17); b.lineTo(x - 5, 2); b.lineTo(x + 5, 2); b.closePath();
      b.strokeStyle = "#fff"; b.lineWidth = 2; b.stroke(); b.fill();
    }
  };

  const draw = () => {
    const g = canvas.getContext("2d");
    g.setTransform(1, 0, 0, 1, 0, 0);
    g.clearRect(0, 0, canvas.width, canvas.height);
    g.drawImage(ground, 0, 0);
    if (!chosen) return;
    g.setTransform(place.ratio, 0, 0, place.ratio, 0, 0);
    const x = toX(data.x_mm[chosen.ix]), y = toY(data.y_mm[chosen.iy]);
    for (const [colour, width] of [["#fff", 4], [INK, 1.6]]) {
      g.strokeStyle = colour;
      g.lineWidth = width;
      g.beginPath();
      g.arc(x, y, 6, 0, 2 * Math.PI);
      for (const [a, c] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) { g.moveTo(x + 6 * a, y + 6 * c); g.lineTo(x + 12 * a, y + 12 * c); }
      g.stroke();
    }
  };

  // ---- reading ----
  const say = (x, y, deviation, u) => {
    byId("read-x").textContent = x;
    byId("read-y").textContent = y;
    byId("read-deviation").textContent = deviation;
    byId("read-u").textContent = u;
  };
  const choose = (ix, iy) => {
    if (chosen && chosen.ix === ix && chosen.iy === iy) return;
    const k = iy * nx + ix;
    chosen = { ix, iy, um: known(ix, iy) ? counts[k] / per : null };
    say(
      signed(data.x_mm[ix], 3), signed(data.y_mm[iy], 3),
      chosen.um === null ? "not known" : signed(chosen.um, data.digits),
      chosen.um === null || uCounts[k] === UNKNOWN_U ? "\u2013" : (uCounts[k] / 10 ** data.u_digits).toFixed(Math.max(0, data.u_digits)),
    );
    draw();
    drawBar();
  };
  const leave = () => {
    chosen = null;
    say("\u2013", "\u2013", "\u2013", "\u2013");
    draw();
    drawBar();
  };
  const follow = (event) => {
    const box = canvas.getBoundingClientRect(), shrunk = place.width / box.width;
    const x = world.x + ((event.clientX - box.left) * shrunk - LEFT) / place.scale;
    const y = world.y + world.h - ((event.clientY - box.top) * shrunk - TOP) / place.scale;
    const ix = Math.round((x - x0) / dx), iy = Math.round((y - y0) / dy);
    if (ix >= -1 && iy >= -1 && ix <= nx && iy <= ny)
      choose(Math.min(Math.max(ix, 0), nx - 1), Math.min(Math.max(iy, 0), ny - 1));
  };
  canvas.addEventListener("pointermove", follow);
  canvas.addEventListener("pointerdown", follow);

  const nodeAt = (e) => [Math.round((e.x_mm - x0) / dx), Math.round((e.y_mm - y0) / dy)]
    .map((v, k) => Math.min(Math.max(v, 0), (k ? ny : nx) - 1));
  canvas.addEventListener("keydown", (event) => {
    const far = event.shiftKey ? 10 : 1;
    const move = { ArrowLeft: [-far, 0], ArrowRight: [far, 0], ArrowUp: [0, far], ArrowDown: [0, -far] }[event.key];
    if (event.key === "Escape") leave();
    else if (event.key === "Home" || (move && !chosen)) choose(...nodeAt(data.extremes[0]));
    else if (event.key === "End") choose(...nodeAt(data.extremes[1]));
    else if (move)
      choose(Math.min(Math.max(chosen.ix + move[0], 0), nx - 1), Math.min(Math.max(chosen.iy + move[1], 0), ny - 1));
    else return;
    event.preventDefault();
  });

  // ---- the range of the colours ----
  const STEPS = 40; // of the slider to ten times more or less
  const beyond = () => {
    let n = 0, all = 0;
    for (const count of counts) if (count !== UNKNOWN) { all++; if (Math.abs(count) > limit * per) n++; }
    const percent = (100 * n) / Math.max(all, 1);
    byId("beyond").textContent = n === 0 ? "No node is beyond the colours."
      : `${percent < 0.1 ? "Under 0.1" : percent.toFixed(1)} % of the nodes are beyond the colours.`;
  };
  const setLimit = (um, from) => {
    if (!(um > 0) || !Number.isFinite(um)) return;
    limit = um;
    if (from !== slider) slider.value = Math.round(STEPS * Math.log10(um / data.limit_um));
    if (from !== exact) exact.value = three(um);
    slider.setAttribute("aria-valuetext", `plus or minus ${three(um)} micrometres`);
    beyond();
    colour();
  };
  let waiting = false;
  slider.addEventListener("input", () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      const v = Number(slider.value);
      setLimit(v === 0 ? data.limit_um : Number((data.limit_um * 10 ** (v / STEPS)).toPrecision(2)), slider);
    });
  });
  exact.addEventListener("change", () => setLimit(Number(exact.value), exact));
  byId("reset").addEventListener("click", () => setLimit(data.limit_um, null));

  for (const button of document.querySelectorAll(".enlarge"))
    button.addEventListener("click", () =>
      button.setAttribute("aria-expanded", button.parentElement.classList.toggle("large")));

  let width = 0;
  const fit = () => {
    const now = canvas.parentElement.clientWidth;
    if (now && now !== width && !window.matchMedia("print").matches) { width = now; layout(); }
  };
  fit();
  setLimit(data.limit_um, null);
  new ResizeObserver(fit).observe(canvas.parentElement);

  // ---- paper: one sheet, whatever the page has to say ----
  const paper = byId("paper"), sheet = byId("sheet"), SHEET_MM = { width: 190, height: 277 };
  window.addEventListener("afterprint", () => layout());
  window.addEventListener("beforeprint", () => {
    leave();
    layout(PAPER);
    const mm = 96 / 25.4, root = document.documentElement;
    root.style.setProperty("--fit", 1);
    paper.media = "all";
    sheet.style.width = SHEET_MM.width * mm + "px";
    for (let zoom = 1; zoom > 0.3; zoom *= 0.97) {
      root.style.setProperty("--fit", zoom);
      sheet.style.width = (SHEET_MM.width * mm) / zoom + "px";
      if (sheet.getBoundingClientRect().height <= SHEET_MM.height * mm - 2) break;
    }
    sheet.style.width = "";
    paper.media = "print";
  });
})();
