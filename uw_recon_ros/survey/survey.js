"use strict";
// Choosing a frame: by its picture, its row, a click on a time line, or its number. Its view is a page of its own.
(() => {
  const survey = JSON.parse(document.getElementById("survey").textContent), frames = survey.frames;
  const frame = document.querySelector("iframe.view"), input = document.getElementById("number");
  const says = document.getElementById("says"), open = document.getElementById("open");
  const place = new Map(frames.map((row, k) => [row[0], k]));
  let now = place.get(survey.shown);

  const name = number => `${String(number).padStart(6, "0")}`;
  const two = value => String(value).padStart(2, "0");
  // Since the first frame: 12.3 s, 4:05, 2:04:05.
  const clock = time => {
    const s = Math.floor(time), h = Math.floor(s / 3600), m = Math.floor(s / 60) % 60;
    return s < 60 ? `${Number(time.toFixed(2))} s` : h ? `${h}:${two(m)}:${two(s % 60)}` : `${m}:${two(s % 60)}`;
  };
  const show = value => value === null ? "–" : Number(value.toPrecision(3));

  function choose(k, scroll) {
    if (k === undefined || k < 0 || k >= frames.length) return;
    now = k;
    const [number, time, density, rows, depth, seen, reason] = frames[k];
    input.value = number;
    says.textContent = reason ? `failed: ${reason}`
      : `${survey.stamped ? `${clock(time)}, ` : ""}density ${Math.round(100 * density)} %, epipolar (row) error ${show(rows)} px, depth ${show(depth)} ${survey.unit}`;
    open.hidden = !seen;
    open.href = `views/${name(number)}.html`;
    if (frame && number === survey.shown) { frame.removeAttribute("src"); frame.srcdoc = survey.first; }
    else if (frame && seen) { frame.removeAttribute("srcdoc"); frame.src = `views/${name(number)}.html`; }
    document.querySelectorAll("[data-frame]").forEach(e => e.setAttribute("aria-pressed", String(+e.dataset.frame === number)));
    document.querySelectorAll(".chart .cursor").forEach(line => {
      const right = line.ownerSVGElement.viewBox.baseVal.width - survey.margin;
      const x = survey.left + (time - survey.start) / (survey.end - survey.start) * (right - survey.left);
      line.setAttribute("x1", x); line.setAttribute("x2", x);
    });
    if (scroll) document.getElementById("view").scrollIntoView({ behavior: "smooth" });
  }

  document.querySelectorAll("[data-frame]").forEach(e => e.addEventListener("click", () => choose(place.get(+e.dataset.frame), true)));
  document.getElementById("back").addEventListener("click", () => choose(now - 1));
  document.getElementById("next").addEventListener("click", () => choose(now + 1));
  input.addEventListener("change", () => {
    const wanted = Number(input.value);
    choose(frames.reduce((best, row, k) => Math.abs(row[0] - wanted) < Math.abs(frames[best][0] - wanted) ? k : best, 0));
  });
  document.querySelectorAll(".chart").forEach(chart => chart.addEventListener("click", event => {
    const box = chart.getBoundingClientRect(), width = chart.viewBox.baseVal.width;
    const x = (event.clientX - box.left) / box.width * width;
    const time = survey.start + (x - survey.left) / (width - survey.margin - survey.left) * (survey.end - survey.start);
    choose(frames.reduce((best, row, k) => Math.abs(row[1] - time) < Math.abs(frames[best][1] - time) ? k : best, 0));
  }));
  choose(now);

  // The model's page is as high as what is in it, and as light or dark as this one.
  const model = document.querySelector("iframe.model");
  model?.addEventListener("load", () => {
    const inside = model.contentDocument.documentElement, theme = document.documentElement.dataset;
    model.contentDocument.getElementById("theme").hidden = true;
    const fit = () => { model.style.height = `${model.contentDocument.querySelector(".page").offsetHeight}px`; };
    new ResizeObserver(fit).observe(model.contentDocument.querySelector(".page"));
    addEventListener("themechange", () => {
      inside.dataset.theme = theme.theme;
      model.contentWindow.dispatchEvent(new Event("themechange"));
    });
  });
})();
