// What works on every page without the server's help: stop, shortcuts, look and language.
"use strict";

(() => {
  const texts = () => JSON.parse(document.getElementById("panel-texts")?.textContent ?? "{}");
  const statistics = (window.torquebench ??= { painted: 0, stopMilliseconds: null });

  // For charts, which can't read the style sheet by themselves.
  window.cssColour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  window.chartNumber = (value) => String(Number(value.toPrecision(6))).replace("-", "−");

  // Ends of an axis a little beyond the values, where ECharts' own would leave a third empty.
  const chartStep = ({ min, max }) => {
    const tenth = (max - min) / 10 || 1;
    const power = 10 ** Math.floor(Math.log10(tenth));
    return power * [1, 2, 5, 10].find((step) => step * power >= tenth * 0.999);
  };
  window.chartLow = (span) => Math.floor(span.min / chartStep(span) + 1e-9) * chartStep(span);
  window.chartHigh = (span) => Math.ceil(span.max / chartStep(span) - 1e-9) * chartStep(span);

  // A chart that was made before its place had a width keeps 100 px: NiceGUI skips that resize.
  setInterval(() => {
    for (const place of document.querySelectorAll(".chart")) {
      const drawn = place.querySelector("canvas");
      if (!drawn || Math.abs(drawn.clientWidth - place.clientWidth) < 2) continue;
      window.getElement?.(Number(place.id.slice(1)))?.chart?.resize();
    }
  }, 500);

  function alarm(text) {
    const region = document.getElementById("stop-result");
    if (!region) return;
    region.textContent = text;
    region.hidden = text === "";
  }

  let stopping = false;
  async function stop(button) {
    if (stopping) return;
    stopping = true;
    button?.classList.add("pressed");
    const started = performance.now();
    try {
      const answer = await fetch("/panel/stop", {
        method: "POST",
        credentials: "same-origin",
        headers: { "X-Torquebench": "panel" },
        signal: AbortSignal.timeout(2000),
      });
      if (!answer.ok) throw new Error(String(answer.status));
      statistics.stopMilliseconds = performance.now() - started;
      alarm("");
    } catch {
      alarm(texts().stopFailed ?? "STOP?");
    } finally {
      button?.classList.remove("pressed");
      stopping = false;
    }
  }

  const stopButton = (event) => event.target.closest?.("[data-stop]");
  document.addEventListener("pointerdown", (event) => {
    if (stopButton(event) && event.button === 0) stop(stopButton(event));
  }, true);
  document.addEventListener("click", (event) => {
    // A click without a pointer comes from the keyboard or from assistive technology.
    if (stopButton(event) && event.detail === 0) stop(stopButton(event));
  }, true);

  document.addEventListener("keydown", (event) => {
    if (event.key === "F8") {
      event.preventDefault();
      stop(document.querySelector("[data-stop]"));
    } else if (event.altKey && !event.ctrlKey && !event.metaKey && /^Digit[1-9]$/.test(event.code)) {
      const target = document.querySelector(`.rail [data-shortcut="${event.code.slice(-1)}"]`);
      if (target) {
        event.preventDefault();
        target.click();
      }
    }
  });

  function remember(name, value) {
    const secure = window.location.protocol === "https:" ? "; Secure" : "";
    document.cookie = `${name}=${value}; Path=/; Max-Age=31536000; SameSite=Strict${secure}`;
  }
  document.addEventListener("click", (event) => {
    const chosen = event.target.closest?.("[data-choose]");
    if (!chosen) return;
    remember(chosen.dataset.choose, chosen.dataset.value);
    window.location.reload();
  });

  // Unlike a page of text, a page of a machine must never look alive when nobody feeds it.
  const markLost = () => {
    const lost = document.getElementById("popup")?.getAttribute("aria-hidden") === "false";
    document.documentElement.classList.toggle("lost", lost);
  };
  window.addEventListener("load", () => {
    const popup = document.getElementById("popup");
    if (!popup) return;
    popup.setAttribute("role", "alert");
    const [lost, again] = popup.querySelectorAll("span");
    if (texts().lost) {
      lost.textContent = texts().lost;
      again.textContent = texts().reconnecting;
    }
    new MutationObserver(markLost).observe(popup, { attributes: true });
  });
})();
