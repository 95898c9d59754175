// The page of a run: plots over time with one cursor, a clock that the robot follows, marks of what happened.
"use strict";
(async () => {
  const packed = Uint8Array.from(atob(document.getElementById("page-data").textContent), (c) => c.charCodeAt(0));
  const opened = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const data = JSON.parse(await new Response(opened).text());
  const reduced = (value) => (value == null ? "–" : Number(value.toPrecision(4)).toString());

  // ---- numbers: float64 as they are; curves in 65 535 steps between their least and largest value, the last is a gap
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const arrays = data.arrays.map((packed) => {
    if (packed.f64 !== undefined) return Array.from(new Float64Array(bytes(packed.f64)));
    if (packed.f32 !== undefined) return Array.from(new Float32Array(bytes(packed.f32)), (v) => (isFinite(v) ? v : null));
    const raw = new Uint8Array(bytes(packed.u16)), count = raw.length / 2, step = (packed.high - packed.low) / 65534;
    const steps = new Uint16Array(count);  // as differences of differences: lower bytes, then upper ones
    for (let i = 0; i < count; i++) { const z = raw[i] | (raw[count + i] << 8); steps[i] = (z >>> 1) ^ -(z & 1); }
    for (let times = packed.times; times > 0; times--) for (let i = 1; i < count; i++) steps[i] += steps[i - 1];
    const values = Array.from(steps, (k) => (k === 65535 ? null : packed.low + k * step));
    values.decimals = step > 0 ? Math.min(Math.max(Math.ceil(-Math.log10(step)), 0), 12) : 12;  // what a step can tell
    return values;
  });

  // ---- the clock: one time [s] for everything on the page
  const clock = { t: 0, playing: false, speed: 1, end: data.seconds, step: data.dt };
  const followers = [];
  function go(t) {
    clock.t = Math.min(Math.max(t, 0), clock.end);
    for (const follow of followers) follow(clock.t);
  }
  let last = 0;
  function frame(now) {
    if (!clock.playing) return;
    const t = clock.t + Math.min(now - last, 100) * 1e-3 * clock.speed;
    last = now;
    go(t);
    if (t >= clock.end) play(false);
    requestAnimationFrame(frame);
  }
  function play(on) {
    clock.playing = on;
    if (on && clock.t >= clock.end) go(0);
    last = performance.now();
    if (on) requestAnimationFrame(frame);
    for (const button of document.querySelectorAll("[data-play]")) {
      button.textContent = on ? "❚❚" : "▶";
      button.setAttribute("aria-label", on ? "pause" : "play");
    }
  }

  // ---- colours, which follow light and dark
  const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const colour = (k) => () => style(`--curve-${k % 8}`);
  const dashes = [undefined, [7, 4], [2, 3], [10, 3, 2, 3]];
  const dashOfBound = (bounds, k) => {  // a bound without a label belongs to the one before it
    const before = bounds.slice(1, k + 1).filter((bound) => bound.label).length;
    return [[5, 3], [2, 2], [11, 3], [8, 3, 2, 3]][before % 4];
  };
  const sample = (dash) => `<svg viewBox="0 0 26 6" aria-hidden="true"><path d="M0 3H26" stroke-dasharray="${dash.join(" ")}"/></svg>`;
  const ink = () => style("--ink"), line = () => style("--line"), soft = () => style("--soft");

  // ---- plots
  const plots = [];
  const visible = new WeakMap();
  const watcher = new IntersectionObserver((seen) => {
    for (const one of seen) visible.set(one.target, one.isIntersecting);
    if (!hovering) point(clock.t);
  }, { rootMargin: "100px" });
  let hovering = false;

  function marks(spec) {
    const label = (text, kind) => Object.assign(document.createElement("span"), { className: kind, textContent: text });
    const head = document.createElement("i");
    head.className = "head";
    const names = spec.strips.map((strip) => label(strip.label, "strip"));
    return {
      head,
      hooks: {
        setScale: [(u, key) => { if (key === "x" && spec.time) spread(u); }],
        ready: [(u) => u.over.append(...(spec.time ? [head] : []), ...names)],
        drawClear: [(u) => {
          if (!spec.time) return;
          u.ctx.save();
          for (const event of data.events) {
            if (event.kind !== "push" && event.kind !== "fault") continue;
            if (event.start <= 0 && event.end >= data.seconds) continue;  // what lasts all the time marks none of it
            rectangle(u, event.start, event.end, 0, 1, style("--push"));
          }
          spec.strips.forEach((strip, k) => {
            const height = 1 / spec.strips.length;
            const paint = colour(strip.colour)();
            u.ctx.globalAlpha = 0.5;
            strip.intervals.forEach(([a, b]) => rectangle(u, a, b, (k + 0.55) * height, (k + 0.95) * height, paint));
          });
          u.ctx.restore();
        }],
        draw: [(u) => {
          const { ctx, bbox } = u, ratio = devicePixelRatio;
          ctx.save();
          ctx.strokeStyle = style("--bad");
          ctx.lineWidth = ratio;
          spec.bounds.forEach((bound, k) => {
            const axis = bound.along === "x" ? "x" : "y", at = u.valToPos(bound.value, axis, true);
            const from = axis === "y" ? bbox.top : bbox.left, size = axis === "y" ? bbox.height : bbox.width;
            if (at < from - 1 || at > from + size + 1) return;
            ctx.setLineDash(dashOfBound(spec.bounds, k).map((length) => length * ratio));
            ctx.beginPath();
            if (axis === "y") { ctx.moveTo(bbox.left, at); ctx.lineTo(bbox.left + bbox.width, at); }
            else { ctx.moveTo(at, bbox.top); ctx.lineTo(at, bbox.top + bbox.height); }
            ctx.stroke();
          });
          for (const event of spec.time ? data.events : []) {
            if (event.kind !== "failed" || event.plot !== spec.name) continue;
            const x = u.valToPos(event.start, "x", true);
            if (x < bbox.left || x > bbox.left + bbox.width) continue;
            ctx.setLineDash([]);
            ctx.beginPath();
            ctx.moveTo(x, bbox.top);
            ctx.lineTo(x, bbox.top + bbox.height);
            ctx.stroke();
          }
          ctx.restore();
          spec.strips.forEach((_, k) => { names[k].style.top = `${(k / spec.strips.length) * bbox.height / ratio - 1}px`; });
          place(u, head);
        }],
      },
    };
  }
  // the names of bounds stand below the plot, where they hide no curve
  function key(bounds) {
    const list = Object.assign(document.createElement("div"), { className: "bounds" });
    bounds.forEach((bound, k) => {
      if (!bound.label) return;
      const one = document.createElement("span");
      one.innerHTML = sample(dashOfBound(bounds, k));
      one.append(bound.label);
      list.append(one);
    });
    return list;
  }
  // of a logarithmic axis over many powers of ten, whole powers alone
  const powers = (_, axis, low, high) => {
    const first = Math.ceil(Math.log10(low) - 1e-9), last = Math.floor(Math.log10(high) + 1e-9), step = Math.ceil((last - first + 1) / 8);
    if (last - first < 4) return [...Array(last - first + 2).keys()].flatMap((k) => [1, 2, 3, 4, 5, 6, 7, 8, 9].map((m) => m * 10 ** (first - 1 + k))).filter((v) => v >= low * 0.999 && v <= high * 1.001);
    return [...Array(last - first + 1).keys()].filter((k) => k % step === 0).map((k) => 10 ** (first + k));
  };
  const labelled = (u, splits, axis, space) => {  // 1, 2 and 5 times a power, while there is room
    let last = Infinity;
    return splits.map((v) => {
      if (splits.length > 6 && !/^[125](\.0+)?e/.test(v.toExponential())) return null;
      const at = u.valToPos(v, axis ? "y" : "x"), free = Math.abs(at - last) > (axis ? 12 : 26) || last === Infinity;
      if (free) last = at;
      return free ? v : null;
    });
  };
  function rectangle(u, start, end, top, bottom, fill) {
    const left = Math.max(u.valToPos(start, "x", true), u.bbox.left);
    const right = Math.min(u.valToPos(end, "x", true), u.bbox.left + u.bbox.width);
    if (right <= left) return;
    u.ctx.fillStyle = fill;
    u.ctx.fillRect(left, u.bbox.top + top * u.bbox.height, Math.max(right - left, 1), (bottom - top) * u.bbox.height);
  }
  function place(u, head) {
    const x = u.valToPos(clock.t, "x");
    head.hidden = !(x >= 0 && x <= u.over.clientWidth);
    head.style.transform = `translateX(${x}px)`;
  }

  function make(box) {
    const spec = data.plots[box.dataset.plot];
    const tables = spec.tables.map((table) => [arrays[table.x], ...table.curves.map((curve) => arrays[curve.values])]);
    const [x, ...unsorted] = tables.length > 1 ? uPlot.join(tables) : tables[0], first = x[0], final = x[x.length - 1];
    const every = spec.tables.flatMap((table) => table.curves), order = [...every.keys()].sort((a, b) => every[b].shown - every[a].shown);
    const curves = order.map((k) => every[k]), columns = order.map((k) => unsorted[k]);  // those that are seen come first
    const { head, hooks } = marks(spec);
    const whole = (u) => { const { min, max } = u.scales.x; return min == null || (min <= first + 1e-12 && max >= final - 1e-12); };
    const bounded = [...spec.bounds.filter((bound) => bound.along !== "x").map((bound) => bound.value), ...(spec.reach || [])];
    const across = spec.time ? [] : spec.bounds.filter((bound) => bound.along === "x").map((bound) => bound.value);
    const range = (u, low, high) => {
      if (spec.strips.length) return [0, 1];
      if (low == null) { low = 0; high = 1; }
      if (whole(u)) { low = Math.min(low, ...bounded); high = Math.max(high, ...bounded); }
      if (spec.zero) { low = Math.min(low, 0); if (high <= low) high = low + 1; }
      if (spec.log.includes("y")) return uPlot.rangeLog(low, high, 10, false);
      const room = (high - low || Math.abs(high) || 1) * 0.06;
      return [spec.zero && low >= 0 ? 0 : low - room, high + room];
    };
    const axis = { stroke: soft, grid: { stroke: line, width: 1 }, ticks: { stroke: line, width: 1, size: 4 },
                   font: "11px system-ui, sans-serif", labelFont: "11px system-ui, sans-serif" };
    const bars = spec.bars ? { paths: uPlot.paths.bars({ size: [1, Infinity], align: 1 }), fill: colour(0) } : spec.steps ? { paths: uPlot.paths.stepped({ align: 1 }) } : spec.lines ? {} : { paths: () => null };
    const u = new uPlot({
      width: Math.max(box.clientWidth, 200), height: spec.strips.length ? 40 + 28 * spec.strips.length : 190,
      scales: {
        x: { time: false, distr: spec.log.includes("x") ? 3 : 1, range: (u, low, high) => {
          if (spec.time && first === final) return [first, first + clock.step];  // of one tick
          if (low === first && high === final) { low = Math.min(low, ...across); high = Math.max(high, ...across); }
          return spec.log.includes("x") && !spec.dots ? uPlot.rangeLog(low, high, 10, false) : [low, high];
        } },
        y: { distr: spec.log.includes("y") ? 3 : 1, range },
      },
      axes: [{ ...axis, ...(spec.log.includes("x") ? { splits: spec.dots && x.length < 10 ? () => x : powers, filter: labelled } : {}), size: 28, space: 60, values: (_, ticks) => ticks.map((v) => (v == null ? "" : short(v))) },
             { ...axis, ...(spec.log.includes("y") ? { splits: powers, filter: labelled } : {}), size: 58, grid: { show: !spec.strips.length, stroke: line, width: 1 }, ticks: { show: !spec.strips.length, stroke: line, width: 1, size: 4 },
               values: (_, ticks) => ticks.map((v) => (v == null || spec.strips.length ? "" : short(v))) }],
      series: [
        { label: spec.over, value: (_, v) => reduced(v) },
        ...curves.map((curve) => ({
          label: curve.label, stroke: curve.faint ? soft : colour(curve.colour), width: 1.3, show: curve.shown, points: { show: spec.dots, size: 5, fill: spec.lines ? undefined : colour(curve.colour) },
          dash: curve.colour < 8 ? dashes[curve.dash % dashes.length] : [5, 3],
          value: (u, v, series, row) => {  // of a run with other ticks the last value before
            for (let back = row - 20; v === undefined && row > Math.max(back, 0);) v = u.data[series][--row];
            const { decimals } = arrays[curve.values];
            return reduced(v == null || decimals === undefined ? v : Number(v.toFixed(decimals)));
          }, ...bars,
        })),
        ...(spec.strips.length ? [{ show: false, label: "" }] : []),
      ],
      cursor: {
        y: false, drag: { x: true, y: false, dist: 4 },
        sync: spec.time ? { key: "time", scales: ["x", null], filters: { sub: (type) => type === "mousemove" && visible.get(box) } } : undefined,
      },
      legend: { show: !spec.strips.length },
      hooks,
    }, [x, ...columns, ...(spec.strips.length ? [x.map(() => null)] : [])], box);
    box.plot = u;
    box.querySelectorAll(".u-marker").forEach((marker, k) => {  // the first one is of x
      if (!u.series[k].dash) return;
      marker.outerHTML = sample(u.series[k].dash);
      box.querySelectorAll(".u-series th")[k].firstChild.style.stroke = curves[k - 1].faint ? "var(--soft)" : `var(--curve-${curves[k - 1].colour % 8})`;
    });
    if (spec.bounds.length) box.append(key(spec.bounds));
    if (spec.time) {
      plots.push({ u, box, head });
      let down = 0;
      u.over.addEventListener("mousedown", (event) => { down = event.clientX; });
      u.over.addEventListener("click", (event) => {
        if (Math.abs(event.clientX - down) < 4) { play(false); go(u.posToVal(event.offsetX, "x")); }
      });
      u.over.addEventListener("mouseenter", () => { hovering = true; });
      u.over.addEventListener("mouseleave", () => { hovering = false; requestAnimationFrame(() => point(clock.t)); });
    }
    let held = null;  // two fingers: the values that they were put on
    const fingers = (event) => Array.from(event.touches, (touch) => touch.clientX - u.over.getBoundingClientRect().left);
    u.over.addEventListener("touchstart", (event) => {
      held = event.touches.length === 2 ? fingers(event).map((left) => u.posToVal(left, "x")) : null;
    }, { passive: true });
    u.over.addEventListener("touchmove", (event) => {
      if (!held || event.touches.length !== 2 || spec.log.includes("x")) return;
      event.preventDefault();
      const [a, b] = fingers(event), each = (held[1] - held[0]) / (b - a), min = held[0] - a * each;
      const low = Math.max(min, first), high = Math.min(min + u.over.clientWidth * each, final);
      if (high - low > 2 * clock.step || (!spec.time && high > low)) u.setScale("x", { min: low, max: high });
    }, { passive: false });
    for (const entry of box.querySelectorAll(".u-series th")) {
      entry.tabIndex = 0;
      entry.setAttribute("role", "button");
      entry.addEventListener("keydown", (event) => {
        if (event.key === "Enter" || event.key === " ") { event.preventDefault(); event.stopPropagation(); entry.click(); }
      });
    }
    watcher.observe(box);
    new ResizeObserver(() => {
      const width = Math.floor(box.clientWidth);
      if (width > 100 && width !== u.width) u.setSize({ width, height: u.height });
    }).observe(box);
  }
  function short(v) {
    const size = Math.abs(v);
    return size !== 0 && (size < 1e-3 || size >= 1e5) ? v.toExponential(0).replace("e+", "e") : reduced(v);
  }

  // ---- the cursor of all plots stands where the clock does, unless the pointer is over one of them
  function point(t) {
    for (const { u, box } of plots) {
      if (!visible.get(box)) continue;
      const { min, max } = u.scales.x;
      const at = t > max && t < max + 1.5 * clock.step ? max : t;  // the end is one step behind the last tick
      u.setCursor(at < min || at > max ? { left: -10, top: -10 } : { left: u.valToPos(at, "x"), top: 10 });
    }
  }
  followers.push((t) => {
    for (const { u, box, head } of plots) if (visible.get(box)) place(u, head);
    if (!hovering) point(t);
  });
  function zoom(low, high) {
    const min = Math.max(low, 0), max = Math.min(high, clock.end);
    if (plots.length && max - min >= 2 * clock.step) plots[0].u.setScale("x", { min, max });
  }
  let spreading = false;
  function spread(source) {
    if (spreading) return;
    spreading = true;
    const { min, max } = source.scales.x;
    for (const { u } of plots) if (u !== source) u.setScale("x", { min, max });
    requestAnimationFrame(() => { spreading = false; point(clock.t); });
  }
  function nearer(factor) {
    if (!plots.length) return;
    const { min, max } = plots[0].u.scales.x, half = 0.5 * factor * (max - min);
    factor > 1 && half >= 0.5 * clock.end ? zoom(0, clock.end) : zoom(clock.t - half, clock.t + half);
  }

  // ---- the bar: play, time, marks of what happened
  const slider = document.querySelector("[data-slider]"), said = document.querySelector("[data-time]");
  if (slider) {
    slider.max = clock.end;
    slider.step = clock.step;
    slider.addEventListener("input", () => { play(false); go(Number(slider.value)); });
    followers.push((t) => {
      slider.value = t;
      slider.setAttribute("aria-valuetext", `${t.toFixed(3)} seconds`);
      said.textContent = `${t.toFixed(3)} s`;
    });
    for (const button of document.querySelectorAll("[data-play]")) button.addEventListener("click", () => play(!clock.playing));
    for (const button of document.querySelectorAll("[data-zoom]")) {
      button.addEventListener("click", () => (button.dataset.zoom === "0" ? zoom(0, clock.end) : nearer(Number(button.dataset.zoom))));
    }
    const speed = document.querySelector("[data-speed]");
    speed.addEventListener("change", () => { clock.speed = Number(speed.value); });
  }
  function show(t, name) {
    play(false);
    const box = [...document.querySelectorAll("[data-plot]")].find((one) => data.plots[one.dataset.plot].name === name);
    zoom(t - 0.25, t + 0.25);
    go(t);
    if (box) box.scrollIntoView({ block: "center", behavior: "instant" });
  }
  for (const link of document.querySelectorAll("[data-at]")) {
    link.addEventListener("click", (event) => {
      event.preventDefault();
      show(Number(link.dataset.at), link.dataset.shows);
    });
  }
  const moments = [...new Set(data.events.map((event) => event.start))].sort((a, b) => a - b);
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || /^(SELECT|TEXTAREA)$/.test(event.target.tagName)) return;
    const inside = event.target.tagName === "BUTTON" || event.target.tagName === "SUMMARY";
    const step = event.shiftKey ? 0.1 : clock.step;
    const next = (list) => list.find((t) => t > clock.t + 1e-6), previous = (list) => list.findLast((t) => t < clock.t - 1e-6);
    const done = {
      " ": () => (inside ? false : play(!clock.playing)),
      ArrowRight: () => go(clock.t + step), ArrowLeft: () => go(clock.t - step),
      Home: () => go(0), End: () => go(clock.end),
      n: () => go(next(moments) ?? clock.t), p: () => go(previous(moments) ?? clock.t),
      "+": () => nearer(0.5), "=": () => nearer(0.5), "-": () => nearer(2), 0: () => zoom(0, clock.end),
    }[event.key];
    if (done && done() !== false) event.preventDefault();
  });

  // ---- maps: a way in the plane, with a dot where the clock is
  for (const box of document.querySelectorAll("[data-map]")) {
    const spec = data.maps[box.dataset.map], t = arrays[spec.t], x = arrays[spec.x], y = arrays[spec.y];
    const dot = box.querySelector(".dot");
    followers.push((now) => {
      let k = Math.min(Math.round((now - t[0]) / ((t[t.length - 1] - t[0]) / Math.max(t.length - 1, 1) || 1)), t.length - 1);
      k = Math.max(k, 0);
      dot.style.display = x[k] == null ? "none" : "";
      if (x[k] != null) { dot.setAttribute("cx", x[k]); dot.setAttribute("cy", -y[k]); }
    });
  }

  // ---- why: what explain() says of the tick where the clock is
  for (const panel of document.querySelectorAll("[data-why]")) {
    const why = data.whys[panel.dataset.why], t = arrays[why.t], status = arrays[why.status];
    const cell = (kind, text) => Object.assign(document.createElement(kind), { textContent: text });
    const table = (headings, rows) => {
      const made = document.createElement("table"), body = document.createElement("tbody"), first = document.createElement("tr");
      first.append(...headings.map((text) => Object.assign(cell("th", text), { scope: "col" })));
      body.append(first, ...rows.map((row) => {
        const line = document.createElement("tr");
        line.append(...row.map((text) => cell("td", text)));
        return line;
      }));
      made.append(body);
      return made;
    };
    const sizes = (list, k) => list.filter(([values]) => arrays[values][k] != null).map(([values, unit]) => `${three(arrays[values][k])} ${unit}`).join(", ");
    const three = (v) => (v == null ? "–" : Math.abs(v) < 1e-12 ? "0" : Math.abs(v) < 1e-3 ? v.toExponential(2) : Number(v.toPrecision(3)).toString());
    let shown = -1;
    followers.push((now) => {
      let k = Math.max(0, Math.min(t.length - 1, Math.round(((now - t[0]) / ((t[t.length - 1] - t[0]) || 1)) * (t.length - 1))));
      if (k === shown) return;
      shown = k;
      const solved = why.statuses[Math.round(status[k])] === "solved";
      const rows = why.codes.flatMap((codes, slot) => {
        const code = arrays[codes][k];
        if (code == null) return [];
        const [name, unit] = why.rows[Math.round(code)];
        return [[name, `${three(arrays[why.bounds[slot]][k])} ${unit}`, `${three(arrays[why.multipliers[slot]][k])} per ${unit || "unit"}`]];
      });
      const tasks = why.tasks.map((task) => [task.task, sizes(task.error, k) || "–", sizes(task.residual, k) || "–", arrays[task.share][k] == null ? "–" : `${three(arrays[task.share][k])} %`]);
      panel.replaceChildren(
        cell("h3", `Why${why.name && `, ${why.name}`}, at ${t[k].toFixed(3)} s: ${why.statuses[Math.round(status[k])]}`),
        table(["task", "error", "residual", "share of cost"], tasks),
        ...(solved ? [] : [cell("p", "This tick has no certified solution, so it has no residuals, shares or active rows. The section Verdict explains the first such tick.")]),
        ...(!solved ? [] : [cell("h3", rows.length ? "Active constraints, the largest multiplier first" : "No constraint is active")]),
        ...(rows.length ? [table(["constraint", "bound", "multiplier"], rows)] : []),
      );
    });
  }

  // ---- beginning, light and dark, print
  for (const box of document.querySelectorAll("[data-plot]")) make(box);
  const redraw = () => { for (const box of document.querySelectorAll("[data-plot]")) box.plot.redraw(false); };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  const folded = [];
  addEventListener("beforeprint", () => {
    play(false);
    for (const fold of document.querySelectorAll("details:not([open])")) { folded.push(fold); fold.open = true; }
    document.documentElement.classList.add("printed");
    for (const box of document.querySelectorAll("[data-plot]")) box.plot.setSize({ width: box.parentElement.classList.contains("broad") ? 680 : 330, height: box.plot.height });
    redraw();
  });
  addEventListener("afterprint", () => {
    for (const fold of folded.splice(0)) fold.open = false;
    document.documentElement.classList.remove("printed");
    for (const box of document.querySelectorAll("[data-plot]")) box.plot.setSize({ width: box.clientWidth, height: box.plot.height });
    redraw();
  });
  window.report = { data, arrays, clock, go, play, zoom, show, followers, plots };
  if (window.scenes) window.scenes(window.report);
  const failed = data.events.filter((event) => event.kind === "failed").map((event) => event.start);
  go(failed.length ? Math.min(...failed) : 0);  // a run that failed is opened where it did
})();
