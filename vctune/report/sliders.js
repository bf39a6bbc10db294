// Computes the loop for tried gains from the constants of the page (report/README.md, section 1). It proves nothing.
"use strict";
window.vctune = (() => {
  const given = JSON.parse(document.getElementById("sliders").textContent);
  const doubles = (text) => { // the text begins with the number of bytes of each double
    const size = +text[0], short = atob(text.slice(1)), bytes = new Uint8Array((short.length / size) * 8);
    for (let k = 0; k < short.length; k++) bytes[k + (8 - size) * (Math.floor(k / size) + 1)] = short.charCodeAt(k);
    return [...new Float64Array(bytes.buffer)];
  };
  const numbers = given.numbers.map(doubles);
  const unpacked = (value) => {
    if (typeof value === "number") return numbers[value];
    if (value === null || typeof value !== "object") return value;
    if (Array.isArray(value)) return value.map(unpacked);
    return Object.fromEntries(Object.entries(value).map(([key, each]) => [key, unpacked(each)]));
  };
  const constants = unpacked(given.constants);
  const shipped = given.variables.map((variable) => variable.value);

  const add = (a, b) => [a[0] + b[0], a[1] + b[1]];
  const times = (a, b) => [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]];
  const over = (a, b) => { const c = times(a, [b[0], -b[1]]), n = abs2(b); return [c[0] / n, c[1] / n]; };
  const abs2 = (a) => a[0] * a[0] + a[1] * a[1];
  const re = (a, b) => a[0] * b[0] + a[1] * b[1]; // Re(a conj(b))
  const im = (a, b) => a[1] * b[0] - a[0] * b[1];
  const part = (list, i) => (list ? [list[2 * i], list[2 * i + 1]] : [0, 0]);
  const affine = (number, i, gains) => {
    const v = part(number.velocity, i), p = part(number.position, i);
    return add(part(number.constant, i), [gains[0] * v[0] + gains[1] * p[0], gains[0] * v[1] + gains[1] * p[1]]);
  };
  const least = (values, hz, found) => values.reduce((k, value, i) => (found(i) && (k < 0 || value < values[k]) ? i : k), -1);

  const within = (hz, [low, high]) => hz >= low * (1 - 1e-9) && (high === null || hz <= high * (1 + 1e-9));

  function coupling(numbers, omega) {
    if (given.rigid) return [numbers[1], numbers[0] * omega];
    const [b, m, drag] = numbers.slice(-3), x = m * omega, share = x / (b * b + x * x);
    return [drag + b * x * share, b * b * share];
  }

  function ofMass(numbers, i) {
    if (given.rigid) return numbers[1];
    const [b, m, drag] = numbers.slice(-3), theta = constants.hands.theta[i];
    const r = m * 2 * Math.sin(theta / 2) / given.sample_time, c = b * Math.cos(theta / 2);
    return drag + b * (r * r / (c * c + r * r));
  }

  // For each display: the terms of the error at a frequency, the impedance that a hand feels with a free and with a
  // rigid environment, and Re Z_c and R at an angle (or their duals), both divided by `scale`.
  const admittanceDisplay = {
    gains: (x) => [x[0], x[1]],
    at(x, i) {
      const at = constants.model, b_h = given.operator_damping, Z_0 = given.reference;
      const C_0 = affine(at.controller, i, x), C = at.C ? affine(at.C, i, x) : C_0, D = affine(at.D, i, x);
      const miss = affine(at.miss, i, x), N = at.numerator ? affine(at.numerator, i, x) : [1, 0];
      const Z_c = coupling(x, 2 * Math.PI * at.hz[i]), D2 = abs2(D);
      const P = re(C, D), Q = im(C, miss) + (at.sensor_im ? at.sensor_im[i] * abs2(C_0) : 0);
      const product = Math.sqrt(abs2(C) * D2);
      const needed = (P > 0 ? Q * Q / (product + P) : product - P) - 2 * b_h * re(C, N);
      const resistance = re(N, D) + b_h * abs2(N);
      const free = over(times(D, Z_c), add(times(N, Z_c), C));
      return {
        terms: [Z_0 * Math.sqrt(abs2(N) / D2), Math.sqrt(abs2(miss) / D2), Math.sqrt(abs2(Z_c)) / Z_0],
        impedance: [Math.sqrt(abs2(free)), Math.sqrt(D2 / abs2(N))],
        resistance: [Z_c[0], resistance > 0 ? needed / (2 * resistance) : NaN],
        ratio: [resistance > 0 ? (needed > 0 ? 2 * resistance * Z_c[0] / needed : Infinity) : -Infinity],
      };
    },
    offered: ofMass,
    required(x, h, i) {
      const at = constants.hands, open = part(at.open[h], i), v = part(at.velocity[h], i), p = part(at.position[h], i);
      const felt = part(at.felt[h], i), s = Math.sin(at.theta[i] / 2), lead = given.sample_time * Math.cos(at.theta[i] / 2);
      const even = open[0] + x[0] * v[0] + x[1] * p[0], odd = open[1] + x[0] * v[1] + x[1] * p[1];
      const P = [x[1] * lead * felt[0] - 2 * x[0] * s * s * felt[1], x[1] * lead * felt[1] + 2 * x[0] * felt[0]];
      return -0.5 * (P[1] * even - P[0] * odd) / (even * even + s * s * odd * odd);
    },
    scale: () => 1,
  };
  const impedanceDisplay = {
    gains: (x) => [x[0], 0],
    at([K_v, b_c, k_c], i) {
      const at = constants.model, Z_0 = given.reference, size = (a, b) => Math.sqrt(abs2(a) / abs2(b));
      const D = affine(at.D, i, [K_v, 0]), N = affine(at.numerator, i, [K_v, 0]), wall = [K_v + b_c, k_c];
      const drive = part(at.drive, i), Z_c = affine(at.coupling, i, [b_c, k_c]);
      return {
        terms: [size(D, N) / Z_0, size([N[0] - drive[0], N[1] - drive[1]], N), Z_0 / Math.sqrt(abs2(Z_c))],
        impedance: [size(D, N), size(affine(at.D, i, wall), affine(at.numerator, i, wall))],
      };
    },
    offered([, b, k], i) {
      const [damper, spring, damper2, both, spring2] = constants.hands.offered.slice(5 * i, 5 * i + 5);
      return (damper * b + spring * k) / (damper2 * b * b + both * b * k + spring2 * k * k);
    },
    required([K_v], h, i) {
      const [lost, more, size, slope, square] = constants.hands.required[h].slice(5 * i, 5 * i + 5);
      const below = size + K_v * (slope + K_v * square);
      return below > 0 ? (lost + K_v * more) / below : Infinity;
    },
    scale: (i) => Math.sin(constants.hands.theta[i] / 2) ** 2,
  };
  const servo = {
    at(x, i) {
      const at = constants.model, Z_c = abs2(coupling(x, 2 * Math.PI * at.hz[i]));
      return {
        terms: [0, Math.sqrt(abs2(part(at.miss, i))), Math.sqrt(Z_c) / given.reference],
        impedance: [Math.sqrt(Z_c / abs2(part(at.C, i)))],
      };
    },
    offered: ofMass,
    required: (_, h, i) => constants.hands.required[h][i],
    scale: () => 1,
  };
  const display = { admittance: admittanceDisplay, impedance: impedanceDisplay, servo }[given.display];

  function frequencyModel(x) {
    const at = constants.model, curves = { hz: at.hz, admittance: [[]], tracking: [[]], coupling: [[]], error: [[]] };
    const squares = [0, 1, 2, 3].map(() => ({ mean: 0, peak: 0 })); // mean and peak of the error and of its three terms
    at.hz.forEach((hz, i) => {
      const { terms, ...felt } = display.at(x, i);
      for (const [name, values] of Object.entries(felt)) {
        curves[name] ??= values.map(() => []);
        values.forEach((value, k) => curves[name][k].push(value));
      }
      ["admittance", "tracking", "coupling"].forEach((name, k) => curves[name][0].push(terms[k]));
      const e2 = terms.reduce((total, term, k) => total + (given.weights[k] * term) ** 2, 0);
      curves.error[0].push(Math.sqrt(e2));
      squares.forEach((square, k) => {
        const value = k ? terms[k - 1] ** 2 : e2;
        square.mean += at.weight[i] * value;
        if (within(hz, given.transparency_hz)) square.peak = Math.max(square.peak, value);
      });
    });
    const [error, , , given_way] = squares.map((square) => Math.sqrt(given.norm === "rms" ? square.mean : square.peak));
    const band = given.band_hz;
    if (!band) return { curves, error, given_way };
    const k = least(curves.ratio[0], at.hz, (i) => within(at.hz[i], band));
    return { curves, error, given_way, ratio: curves.ratio[0][k], ratio_hz: at.hz[k] };
  }

  function sampledLoop(x) {
    const at = constants.sampled;
    if (!at) return {};
    const curve = { x: [], y: [] }, [K_v, K_p] = display.gains(x);
    let peak = 0, peak_hz = 0, turned = 0, before = [1, 0];
    at.theta.forEach((theta, i) => {
      const open = part(at.open, i), v = part(at.velocity, i), p = part(at.position, i);
      const gain = [K_v * v[0] + K_p * p[0], K_v * v[1] + K_p * p[1]], F = add(open, gain), L = over(gain, open);
      const S = Math.sqrt(abs2(open) / abs2(F));
      if (S > peak) [peak, peak_hz] = [S, theta / (2 * Math.PI * given.sample_time)];
      turned += Math.atan2(im(F, before), re(F, before));
      before = F;
      curve.x.push(L[0]);
      curve.y.push(L[1]);
    });
    return { curve, peak, peak_hz, unstable: Math.abs(Math.round(turned / Math.PI)) };
  }

  function inHands(x) {
    const at = constants.hands;
    if (!at) return {};
    const hz = at.theta.map((theta) => theta / (2 * Math.PI * given.sample_time));
    const most = hz.map(() => -Infinity), whose = hz.map(() => 0), there = hz.map((_, i) => display.offered(x, i));
    given.hands.forEach((_, h) => hz.forEach((_, i) => {
      const R = display.required(x, h, i);
      if (R > most[i]) [most[i], whose[i]] = [R, h];
    }));
    const ratio = hz.map((_, i) => (most[i] > 0 ? there[i] / most[i] : Infinity)), k = least(ratio, hz, () => true);
    const shown = [there, most].map((values) => values.map((value, i) => value * display.scale(i)));
    return { in_hand: shown, hand_ratio: [ratio], hz, least: ratio[k], least_hz: hz[k], hand: given.hands[whose[k]] };
  }

  function evaluate(x) {
    const model = frequencyModel(x), loop = sampledLoop(x), hands = inHands(x);
    const lines = loop.curve ? { nyquist: [[loop.curve.x, loop.curve.y]] } : {};
    for (const [name, found] of Object.entries(model.curves)) if (name !== "hz") lines[name] = found.map((y) => [model.curves.hz, y]);
    for (const name of ["in_hand", "hand_ratio"]) if (hands[name]) lines[name] = hands[name].map((y) => [hands.hz, y]);
    return {
      error: model.error, given_way: model.given_way, ratio: model.ratio, ratio_hz: model.ratio_hz, peak: loop.peak, peak_hz: loop.peak_hz,
      unstable: loop.unstable, hand_ratio: hands.least, hand_ratio_hz: hands.least_hz, hand: hands.hand, lines,
    };
  }

  function path(axes, [xs, ys]) {
    const place = (value, [low, high, logarithmic], start, length) => {
      if (!logarithmic) return start + length * (value - low) / (high - low);
      return value > 0 ? start + length * Math.log(value / low) / Math.log(high / low) : NaN;
    };
    const [left, top, width, height] = axes.box, far = 4 * (width + height);
    let text = "", pen = "M";
    xs.forEach((value, i) => {
      const u = place(value, axes.x, left, width), v = place(ys[i], axes.y, top + height, -height);
      const there = Math.abs(u) < far && Math.abs(v) < far;
      if (there) text += pen + u.toFixed(1) + " " + v.toFixed(1);
      pen = there ? "L" : "M";
    });
    return text;
  }

  const name = "http://www.w3.org/2000/svg";
  function drawn() {
    return Object.entries(given.overlays).flatMap(([figure, all]) => {
      const svg = document.querySelector("#figure-" + figure + " svg");
      return all.map((axes, k) => {
        const frame = document.createElementNS(name, "svg"), [x, y, width, height] = axes.box, outer = svg.viewBox.baseVal;
        Object.entries({ x, y, width, height, viewBox: axes.box.join(" "), class: "tried" }).forEach(([key, value]) => frame.setAttribute(key, value));
        const line = frame.appendChild(document.createElementNS(name, "path"));
        svg.appendChild(frame);
        return { axes, line };
      });
    });
  }

  const text = (value, digits = 4) =>
    value === undefined ? "" : Number.isFinite(value) ? String(+value.toPrecision(digits)) : value > 0 ? "∞" : "none";
  const typeset = (words) => words.replace(/([A-Za-z])_(\w)/g, "<i>$1</i><sub>$2</sub>");
  const made = (parent, tag, properties) => parent.appendChild(Object.assign(document.createElement(tag), properties));

  // A slider is in its middle at the shipped value, or at its start if this value is 0.
  function slider(list, { key, symbol, unit, value, low, top }, change) {
    const start = value > 0 ? 500 : 0, box = made(list, "div", { className: "slider" });
    const at = (share) => (share === start ? value : low > 0 ? low * (top / low) ** (share / 1000) : top * (share / 1000) ** 3);
    const place = (x) => 1000 * (low > 0 ? Math.log(Math.max(x, low) / low) / Math.log(top / low) : Math.cbrt(x / top));
    made(box, "span", { innerHTML: typeset(symbol) });
    const number = made(box, "input", { type: "text", inputMode: "decimal", ariaLabel: key + ", " + unit });
    made(box, "span", { textContent: unit });
    const range = made(box, "input", { type: "range", min: 0, max: 1000, ariaLabel: key });
    const ends = made(box, "div", { className: "ends" });
    for (const end of [text(low, 3) + (start ? "" : " shipped"), start ? "▴ shipped" : "", text(top, 3)]) made(ends, "span", { textContent: end });
    const show = (x) => { number.value = text(x, 5); number.ariaInvalid = "false"; };
    const move = (x) => { range.value = x === value ? start : place(x); range.ariaValueText = text(x) + " " + unit; };
    range.addEventListener("input", () => { const x = at(+range.value); show(x); move(x); change(x); });
    number.addEventListener("input", () => {
      const x = +number.value.replace(",", "."), valid = number.value.trim() !== "" && x >= 0 && x < Infinity;
      number.ariaInvalid = String(!valid);
      if (valid) { move(x); change(x); }
    });
    return () => { show(value); move(value); change(value); };
  }

  function panel() {
    const box = document.getElementById("try"), frames = drawn(), tried = [...shipped];
    const rows = (found) => [
      ["error", text(found.error)],
      ...(display === impedanceDisplay ? [["Z_0 |1/Z_c|", text(found.given_way)]] : []),
      ...(given.band_hz ? [["least ratio on the band", `${text(found.ratio)} at ${text(found.ratio_hz)} Hz`]] : []),
      ...(given.hands.length ? [[given.worlds ? "least ratio in hands, any passive environment" : "least ratio in hands", `${text(found.hand_ratio)} at ${text(found.hand_ratio_hz)} Hz, ${found.hand}`]] : []),
      ...(constants.sampled
        ? [["greatest |S|", `${text(found.peak)} at ${text(found.peak_hz)} Hz`], ["sampled loop", found.unstable ? "unstable" : "stable"]]
        : []),
    ];
    const first = rows(evaluate(shipped)), table = box.querySelector("table");
    const mark = box.querySelector(".mark-of"), notes = document.querySelector(".tries"), file = notes.querySelector("pre");
    function update() {
      const same = tried.every((value, k) => value === shipped[k]), found = evaluate(tried);
      const meets = (ratio) => ratio === undefined || ratio >= given.factor * (1 - 1e-4);
      const outside = given.variables.filter(({ bounds }, k) => bounds && (tried[k] < bounds[0] * (1 - 1e-9) || tried[k] > bounds[1] * (1 + 1e-9)));
      const missed = [
        ...(found.unstable ? ["the loop is unstable"] : []),
        ...(meets(found.ratio) && (given.worlds || meets(found.hand_ratio)) ? [] : [`a ratio is below ${given.factor}`]),
        ...(found.peak > given.max_sensitivity * (1 + 1e-4) ? [`|S| is above ${given.max_sensitivity}`] : []),
        ...outside.map(({ key }) => `${key} is out of bounds`),
      ];
      mark.className = "mark-of " + (same ? given.shipped.kind : missed.length ? "bad" : "doubtful");
      mark.replaceChildren();
      if (same) made(mark, "strong", { textContent: "the shipped design: " + given.shipped.word });
      else {
        made(mark, "strong", { textContent: "tried, not proved" });
        const met = given.worlds
          ? ": these numbers do not include the claim about hands; only the shipped design is proved"
          : ": these samples meet the constraints; only the shipped design is proved";
        made(mark, "span", { textContent: missed.length ? ": " + missed.join(", ") : met });
      }
      table.replaceChildren(...[["", "tried", "shipped"], ...rows(found).map(([label, value], k) => [label, value, first[k][1]])].map((cells) => {
        const row = document.createElement("tr");
        cells.forEach((cell, k) => made(row, k ? "td" : "th", k ? { textContent: cell } : { innerHTML: typeset(cell) }));
        return row;
      }));
      frames.forEach(({ axes, line }) => line.setAttribute("d", same ? "" : found.lines[axes.curve].map((curve) => path(axes, curve)).join("")));
      const tables = {};
      given.variables.forEach(({ key }, k) => {
        const [table, name] = key.split(".");
        tables[table] = `${tables[table] ?? `[${table}]\n`}${name} = ${+tried[k].toPrecision(8)}\n`;
      });
      file.textContent = Object.values(tables).join("");
    }
    const list = box.querySelector(".sliders");
    const resets = given.variables.map((variable, k) => slider(list, variable, (x) => { tried[k] = x; update(); }));
    const back = () => resets.forEach((reset) => reset());
    box.querySelector("button").addEventListener("click", back);
    box.hidden = notes.hidden = false;
    back();
  }

  panel();
  return { evaluate, shipped };
})();
