/* Plots over time that can be looked at closely: drag across one, or its buttons; on a touch screen drag and pinch.
   Data: zoom.py. Where anything here fails, the page's picture stays. */
(() => {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const ink = (color) => {  // on dark paper dark curves become lighter, and pale ones, which stand behind, darker
    const rgb = [1, 3, 5].map((k) => parseInt(color.slice(k, k + 2), 16)), pale = Math.min(...rgb) > 160;
    return dark.matches ? `rgb(${rgb.map((v) => Math.round(pale ? 0.55 * v : 0.65 * v + 90))})` : color;
  };
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const times = (one, length) => one.time ? Array.from(new Float32Array(bytes(one.time)), (t) => one.start + t)
    : Array.from({ length }, (_, k) => one.start + k * one.step);
  const values = (one) => Array.from(new Int16Array(bytes(one.data)), (k) => k === -32768 ? null : one.middle + one.step * k);
  const short = (u, v) => v == null ? "–" : String(+v.toPrecision(4));

  function figure(box, number) {
    const { panels, view } = JSON.parse(box.querySelector("script").textContent), plots = [];
    const place = box.querySelector(".plots"), tools = document.createElement("div");
    let low = Infinity, high = -Infinity, least = Infinity, busy = false;
    const show = (from, to) => {
      const width = Math.min(Math.max(to - from, least), high - low), middle = (from + to) / 2;
      from = Math.min(Math.max(middle - width / 2, low), high - width);
      busy = true;
      plots.forEach((u) => u.setScale("x", { min: from, max: from + width }));
      busy = false;
    };
    const move = (by, size) => {
      const { min, max } = plots[0].scales.x, middle = (min + max) / 2 + by * (max - min), half = size * (max - min) / 2;
      show(middle - half, middle + half);
    };
    tools.className = "tools";
    for (const [sign, title, act] of [["+", "closer", () => move(0, 0.5)], ["−", "wider", () => move(0, 2)], ["←", "earlier", () => move(-0.5, 1)],
      ["→", "later", () => move(0.5, 1)], ["all", "the whole run", () => show(low, high)]]) {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: sign, title, onclick: act });
      button.setAttribute("aria-label", title);
      tools.append(button);
    }
    place.append(tools);

    const touch = (u) => {
      const down = new Map();
      let begun;
      const begin = () => {
        const at = [...down.values()], rect = u.over.getBoundingClientRect(), { min, max } = u.scales.x;
        begun = { at, rect, min, max, time: (x) => min + (x - rect.left) / rect.width * (max - min) };
      };
      u.over.style.touchAction = "pan-y";
      u.over.addEventListener("pointerdown", (e) => { if (e.pointerType === "touch") { down.set(e.pointerId, e.clientX); begin(); } });
      for (const name of ["pointerup", "pointercancel", "pointerleave"])
        u.over.addEventListener(name, (e) => { if (down.delete(e.pointerId)) begin(); });
      u.over.addEventListener("pointermove", (e) => {
        if (!down.has(e.pointerId)) return;
        down.set(e.pointerId, e.clientX);
        const now = [...down.values()], old = begun.at.map(begun.time);
        const per = now.length > 1 ? (old[1] - old[0]) / ((now[1] - now[0]) || 1) : (begun.max - begun.min) / begun.rect.width;
        if (per > 0) show(old[0] - per * (now[0] - begun.rect.left), old[0] + per * (begun.rect.right - now[0]));
      });
    };

    const marks = (own) => (u) => {
      const c = u.ctx, { left, top, width, height } = u.bbox, dots = devicePixelRatio;
      c.save();
      c.beginPath(); c.rect(left, top, width, height); c.clip();
      c.strokeStyle = c.fillStyle = css("--ink"); c.lineWidth = dots; c.textAlign = "left"; c.font = `${11 * dots}px system-ui, sans-serif`;
      const seen = own.filter((m) => m[0] >= u.scales.x.min && m[0] <= u.scales.x.max);
      for (const [t, v, text] of seen) {
        const x = u.valToPos(t, "x", true), y = u.valToPos(v, "y", true);
        c.beginPath(); c.arc(x, y, 3 * dots, 0, 7); c.stroke();
        if (seen.length < 9 && width > 500 * dots) c.fillText(text, x + 6 * dots, y + 4 * dots);
      }
      c.restore();
    };
    const shades = (panel) => (u) => {
      const { left, top, width, height } = u.bbox, within = (v, from, size) => Math.min(Math.max(v, from), from + size);
      const x = (t) => within(u.valToPos(t, "x", true), left, width), y = (v) => within(u.valToPos(v, "y", true), top, height);
      const [low, high] = panel.band || [];
      u.ctx.fillStyle = css("--line");
      if (panel.band) u.ctx.fillRect(left, y(high), width, y(low) - y(high));
      for (const [from, to] of panel.spans) u.ctx.fillRect(x(from), top, x(to) - x(from), height);
    };

    panels.forEach((panel, k) => {
      const last = k === panels.length - 1, curves = panel.series.map(values), x = times(panel, curves[0].length), name = document.createElement("p");
      low = Math.min(low, x[0]); high = Math.max(high, x[x.length - 1]); least = Math.min(least, 8 * (x[1] - x[0]));
      name.className = "axis"; name.textContent = panel.title;
      place.append(name);
      const axis = { stroke: () => css("--soft"), grid: { stroke: () => css("--line"), width: 1 }, ticks: { stroke: () => css("--line"), width: 1 } };
      const u = new uPlot({
        width: Math.max(place.clientWidth, 200), height: last ? 196 : 170,
        cursor: { sync: { key: `zoom-${number}` }, drag: { x: true, y: false }, bind: { dblclick: () => () => show(low, high) } },
        scales: { x: { time: false, auto: false, range: (u, min, max) => [min ?? low, max ?? high] } },
        series: [{ label: "time [s]", value: short }, ...panel.series.map((one) => ({
          label: one.label, stroke: () => ink(one.color), width: one.width, points: { show: false }, value: short }))],
        axes: [{ ...axis, ...(last ? { label: "time [s]", labelSize: 20 } : {}), size: 30 }, { ...axis, size: 58 }],
        hooks: {
          setScale: [(u, key) => { if (key === "x" && !busy && plots.length === panels.length) show(u.scales.x.min, u.scales.x.max); }],
          drawClear: [shades(panel)], draw: panel.marks.length ? [marks(panel.marks)] : [],
        },
      }, [x, ...curves], place);
      touch(u);
      plots.push(u);
    });
    show(...(view ?? [low, high]));
    box.classList.add("live");
    let seen = 0;
    new ResizeObserver(() => {
      if (place.clientWidth && place.clientWidth !== seen) plots.forEach((u) => u.setSize({ width: seen = place.clientWidth, height: u.height }));
    }).observe(place);
    dark.addEventListener("change", () => plots.forEach((u) => u.redraw()));
  }

  document.querySelectorAll("figure.zoom").forEach((box, number) => {
    try { figure(box, number); } catch (error) { box.classList.remove("live"); box.querySelector(".plots").replaceChildren(); console.warn(error); }
  });
})();
