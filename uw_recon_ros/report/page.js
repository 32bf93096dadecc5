"use strict";
// The page scrolls until the view has been clicked: what the wheel then asks of it, or nothing but the hint to click.
globalThis.uwWheel = (view, event) => {
  if (document.activeElement !== view.canvas && !event.ctrlKey) {
    view.root.classList.add("hinting");
    clearTimeout(view.hinting);
    view.hinting = setTimeout(() => view.root.classList.remove("hinting"), 1200);
    return null;
  }
  event.preventDefault();
  return Math.max(-60, Math.min(60, event.deltaY)) * 0.003;
};

// Small comforts: pictures open large, before/after sliders, light and dark.
(() => {
  const dialog = document.getElementById("zoom"), large = dialog.querySelector("img"), words = dialog.querySelector("p");
  document.querySelectorAll("figure button.enlarge").forEach(button => {
    button.addEventListener("click", () => {
      const picture = button.querySelector("img"), caption = button.closest("figure").querySelector("figcaption");
      large.src = picture.src;
      large.alt = picture.alt;
      large.classList.toggle("crisp", picture.classList.contains("crisp"));
      words.textContent = caption.textContent;
      dialog.showModal();
    });
  });
  dialog.addEventListener("click", () => dialog.close());

  document.querySelectorAll(".compare input").forEach(slider => {
    const show = () => slider.parentElement.style.setProperty("--split", `${slider.value}%`);
    slider.addEventListener("input", show);
    show();
  });

  document.getElementById("theme").addEventListener("click", () => {
    const root = document.documentElement, dark = matchMedia("(prefers-color-scheme: dark)").matches;
    const now = root.dataset.theme || (dark ? "dark" : "light");
    root.dataset.theme = now === "dark" ? "light" : "dark";
    dispatchEvent(new Event("themechange"));
  });
})();
