// What works on every page without the server's help: stop, shortcuts, look and language.
"use strict";

(() => {
  const texts = () => JSON.parse(document.getElementById("panel-texts")?.textContent ?? "{}");
  const root = document.documentElement;
  const statistics = (window.torquebench ??= { painted: 0, stopMilliseconds: null, toldMilliseconds: null });

  // For charts, which can't read the style sheet by themselves.
  window.cssColour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  window.chartNumber = (value) => String(Number(value.toPrecision(6))).replace("-", "−");

  // Ends of an axis a little beyond the values, where ECharts' own would leave a third empty.
  const chartStep = ({ min, max }) => {
    const tenth = (max - min) / 10 || 1;
    const power = 10 ** Math.floor(Math.log10(tenth));
    return power * [1, 2, 5, 10].find((step) => step * power >= tenth * 0.999);
  };
  // What lies a hair beyond a round end, as a torque that is held does, is drawn all the same.
  const HAIR = 0.02;
  window.chartLow = (span) => Math.floor(span.min / chartStep(span) + HAIR) * chartStep(span);
  window.chartHigh = (span) => Math.ceil(span.max / chartStep(span) - HAIR) * chartStep(span);

  // A time axis: a little room at both ends, and dates where it is days that differ.
  const DAY_MS = 86400000;
  let days = false; // of the chart that is being drawn: its ends are asked for before its labels
  const room = ({ min, max }) => Math.max((max - min) * 0.04, 500);
  window.chartFirst = (span) => {
    days = span.max - span.min > 2 * DAY_MS;
    return span.min - room(span);
  };
  window.chartLast = (span) => span.max + room(span);
  window.chartMoment = (ms) => {
    const style = days ? { dateStyle: "medium" } : { hour: "2-digit", minute: "2-digit", second: "2-digit", hourCycle: "h23" };
    return new Date(ms).toLocaleString(root.lang.startsWith("en") ? undefined : root.lang, style);
  };

  // A chart that was made before its place had a width keeps 100 px: NiceGUI skips that resize.
  setInterval(() => {
    for (const place of document.querySelectorAll(".chart")) {
      const drawn = place.querySelector("canvas");
      if (!drawn || Math.abs(drawn.clientWidth - place.clientWidth) < 2) continue;
      window.getElement?.(Number(place.id.slice(1)))?.chart?.resize();
    }
  }, 500);

  // A span of a chart is drawn with the mouse, once the chart is there.
  window.drawSpans = (id) => {
    const chart = window.getElement?.(Number(id.slice(1)))?.chart;
    if (!chart || chart.drawsSpans) return;
    chart.drawsSpans = true;
    chart.dispatchAction({ type: "takeGlobalCursor", key: "dataZoomSelect", dataZoomSelectActive: true });
  };

  // Every chart can be taken away: as a picture, and as a table of what it shows.
  function save(name, url) {
    const link = document.createElement("a");
    link.href = url;
    link.download = name;
    link.click();
  }
  function saveTable(name, lines) {
    const url = URL.createObjectURL(new Blob([lines.join("\r\n") + "\r\n"], { type: "text/csv" }));
    save(name, url);
    setTimeout(() => URL.revokeObjectURL(url), 60000);
  }
  Object.assign(statistics, { save, saveTable }); // for the live chart, too
  const named = { picture: "savePicture", table: "saveTable" };
  setInterval(() => {
    for (const tool of document.querySelectorAll("[data-chart-tool]:not([title])")) {
      tool.title = texts()[named[tool.dataset.chartTool]] ?? "";
      const label = document.getElementById(tool.dataset.chart)?.ariaLabel ?? "";
      tool.ariaLabel = `${tool.title}: ${label}`;
    }
  }, 500);
  const csvCell = (value) => (typeof value === "number" ? String(value) : `"${String(value ?? "").replaceAll('"', '""')}"`);
  function chartTable(option) {
    const [x] = option.xAxis, [y] = option.yAxis;
    const lines = [["series", x.name || "x", y.name || "y"]];
    const moment = (value) => (x.type === "time" && value !== null ? new Date(value).toISOString() : value);
    for (const series of option.series) {
      if (!series.name) continue;
      series.data.forEach((point, place) => {
        const pair = Array.isArray(point) ? point : [x.data?.[place] ?? place, point?.value ?? point];
        lines.push([series.name, moment(pair[0]), pair[1]]);
      });
    }
    return lines.map((cells) => cells.map(csvCell).join(","));
  }
  document.addEventListener("click", (event) => {
    const tool = event.target.closest?.("[data-chart-tool]");
    const chart = tool && window.getElement?.(Number(tool.dataset.chart.slice(1)))?.chart;
    if (!chart) return;
    const name = `torquebench-${new Date().toISOString().slice(0, 19).replace(/:/g, "-")}`;
    if (tool.dataset.chartTool === "picture") {
      save(`${name}.png`, chart.getDataURL({ type: "png", pixelRatio: 2, backgroundColor: window.cssColour("--surface") }));
      return;
    }
    saveTable(`${name}.csv`, chartTable(chart.getOption()));
  });

  // Moments by the reader's clock and way of writing; the title keeps UTC.
  setInterval(() => {
    for (const time of document.querySelectorAll("time[datetime]")) {
      if (time.shownFor === time.dateTime && time.textContent === time.shown) continue;
      const timeStyle = time.dataset.seconds ? "medium" : "short";
      time.shownFor = time.dateTime;
      const locale = root.lang.startsWith("en") ? undefined : root.lang;
      const day = time.dateTime.length === 10;
      const style = day ? { timeZone: "UTC" } : { timeStyle };
      time.shown = new Date(time.dateTime).toLocaleString(locale, { dateStyle: "medium", ...style });
      time.textContent = time.shown;
      time.title = day ? time.dateTime : time.dateTime.replace("T", " ").replace("Z", " UTC");
    }
  }, 250);

  function say(place, text) {
    const region = document.getElementById(place);
    if (!region) return;
    region.textContent = text;
    region.hidden = text === "";
  }
  const alarm = (text) => say("stop-result", text);

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
      const { at } = await answer.json(); // by the server's clock: the same on the same computer
      statistics.toldMilliseconds = at * 1000 - performance.timeOrigin - started;
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

  // "?" shows the menu, with all keys, unless somebody types.
  document.addEventListener("keydown", (event) => {
    const typing = event.target.closest?.("input, textarea, select, [contenteditable]");
    if (event.key !== "?" || typing || document.querySelector(".sheet")) return;
    event.preventDefault();
    document.querySelector("[data-menu]")?.click();
  });

  // Notices: a sound and the browser's own notification for a new alarm and the end of an own job.
  // Of several pages of one browser only the first tells; what was there before is old news.
  const NOTICES = "torquebench-notices", NOTICED = "torquebench-noticed";
  const noticing = () => localStorage.getItem(NOTICES) === "on";
  statistics.noticed = [];
  function sound(urgent) {
    const audio = new AudioContext();
    const tone = audio.createOscillator(), volume = audio.createGain();
    tone.frequency.value = urgent ? 880 : 523;
    volume.gain.setValueAtTime(0.2, audio.currentTime);
    volume.gain.exponentialRampToValueAtTime(0.001, audio.currentTime + (urgent ? 1.2 : 0.5));
    tone.connect(volume).connect(audio.destination);
    tone.start();
    tone.stop(audio.currentTime + 1.3);
    tone.onended = () => audio.close();
  }
  function notice(kind, text) {
    statistics.noticed.push(text);
    sound(kind === "alarm");
    if (window.Notification?.permission === "granted") {
      new Notification("torquebench", { body: text, tag: kind, requireInteraction: kind === "alarm" });
    }
  }
  setInterval(() => {
    for (const button of document.querySelectorAll("[data-notices]")) {
      button.setAttribute("aria-pressed", String((button.dataset.notices === "on") === noticing()));
    }
    const found = document.getElementById("notice")?.textContent;
    if (!found) return;
    const news = JSON.parse(found);
    const known = JSON.parse(localStorage.getItem(NOTICED) ?? "null");
    const ids = { ...known };
    for (const kind of ["alarm", "job"]) {
      const [id, text] = news[kind] ?? [];
      if (!id || known?.[kind] === id) continue;
      ids[kind] = id;
      if (known && noticing()) notice(kind, text);
    }
    if (JSON.stringify(ids) !== JSON.stringify(known)) localStorage.setItem(NOTICED, JSON.stringify(ids));
  }, 500);
  document.addEventListener("click", (event) => {
    const chosen = event.target.closest?.("[data-notices]");
    if (!chosen) return;
    localStorage.setItem(NOTICES, chosen.dataset.notices);
    if (chosen.dataset.notices === "on") window.Notification?.requestPermission?.();
  });

  // A press of a button that needs the server shows at once, is done or refused, and never both
  // late and unseen: while the page isn't connected such buttons say so, and a press does nothing.
  const UNHEARD = "torquebench-unheard";
  const connected = () => window.did_handshake === true && window.socket?.connected === true;
  const said = (button) => (button.ariaLabel ?? button.querySelector("span")?.textContent ?? button.textContent).trim();
  const pressed = new Map(); // by id: what was pressed and not answered yet
  const done = (id) => {
    pressed.delete(id);
    document.getElementById(id)?.removeAttribute("aria-busy");
  };
  statistics.heard = (id) => pressed.delete(id); // it takes longer, but it isn't lost
  statistics.done = done;
  const unanswered = (kind, { what }) => (texts()[kind] ?? "").replace("{what}", what);

  document.addEventListener("click", (event) => {
    const button = event.target.closest?.("[data-press]");
    if (!button) return;
    const ready = connected();
    if (ready && !button.hasAttribute("aria-busy")) {
      say("press-result", "");
      button.setAttribute("aria-busy", "true");
      pressed.set(button.id, { what: said(button), goneAt: Infinity });
      return;
    }
    event.preventDefault();
    event.stopImmediatePropagation();
    if (!ready) say("press-result", texts().unready ?? "");
  }, true);

  function watchConnection() {
    const ready = connected();
    if (ready === !root.classList.contains("unready")) return;
    root.classList.toggle("unready", !ready);
    if (ready) {
      const unheard = sessionStorage.getItem(UNHEARD);
      say("press-result", unheard ?? "");
      sessionStorage.removeItem(UNHEARD);
      return;
    }
    for (const [id, press] of pressed) {
      const unheard = unanswered("unheard", press);
      sessionStorage.setItem(UNHEARD, unheard); // the page may be loaded anew before it is read
      say("press-result", unheard);
      done(id);
    }
  }

  // The server ignores a press of what it has replaced already, so that nothing else is meant by it.
  const ANSWER_MS = 1000; // behind the change that a press has brought about
  function watchPresses() {
    for (const [id, press] of pressed) {
      if (document.getElementById(id)) continue;
      press.goneAt = Math.min(press.goneAt, performance.now());
      if (performance.now() - press.goneAt < ANSWER_MS) continue;
      say("press-result", unanswered("changed", press));
      pressed.delete(id);
    }
  }
  setInterval(() => {
    watchConnection();
    watchPresses();
  }, 100);

  // Nothing is rebuilt or moved beneath a finger: what comes between pressing and letting go waits.
  const HELD_MS = 10000; // where letting go is never heard of
  let held = null;
  function letGo() {
    const packets = held?.packets ?? [];
    clearTimeout(held?.timer);
    held = null;
    for (const packet of packets) window.socket.onevent(packet);
  }
  function holdMessages() {
    const socket = window.socket;
    if (!socket || socket.holds) return;
    socket.holds = true;
    const pass = socket.onevent.bind(socket);
    socket.onevent = (packet) => (held ? held.packets.push(packet) : pass(packet));
  }
  document.addEventListener("pointerdown", (event) => {
    if (held || !event.target.closest?.("button, a, label, summary")) return;
    holdMessages();
    held = { packets: [], timer: setTimeout(letGo, HELD_MS) };
  }, true);
  for (const kind of ["pointerup", "pointercancel"]) {
    document.addEventListener(kind, () => setTimeout(letGo), true); // once the click is through
  }
  document.addEventListener("pointermove", (event) => {
    if (held && event.buttons === 0) setTimeout(letGo);
  }, true);

  // Back and forward through the wizard's steps, whose addresses the server has put there.
  window.addEventListener("popstate", () => {
    const calibration = window.location.pathname.startsWith("/calibrations/");
    if (calibration && !window.location.hash) window.location.reload();
  });

  function remember(name, value) {
    const secure = window.location.protocol === "https:" ? "; Secure" : "";
    document.cookie = `${name}=${value}; Path=/; Max-Age=31536000; SameSite=Strict${secure}`;
  }
  document.addEventListener("click", (event) => {
    const chosen = event.target.closest?.("[data-choose]");
    if (!chosen) return;
    chosen.setAttribute("aria-busy", "true"); // until the page is there anew
    remember(chosen.dataset.choose, chosen.dataset.value);
    window.location.reload();
  });

  // Unlike a page of text, a page of a machine must never look alive when nobody feeds it.
  const markLost = () => {
    const lost = document.getElementById("popup")?.getAttribute("aria-hidden") === "false";
    root.classList.toggle("lost", lost);
  };
  window.addEventListener("load", () => {
    const popup = document.getElementById("popup");
    if (!popup) return;
    popup.setAttribute("role", "alert");
    const ours = [texts().lost, texts().reconnecting, texts().tooLong, texts().shorten];
    const spans = document.querySelectorAll("#popup span, #too_long_message_popup span");
    if (ours[0]) spans.forEach((span, place) => { span.textContent = ours[place]; });
    new MutationObserver(markLost).observe(popup, { attributes: true });
  });
})();
