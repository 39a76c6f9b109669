// The live view's chart and numbers. Rows come in small increments; the browser draws them once a
// frame. Every buffer has a fixed size, so an hour costs no more memory than a minute. Who zooms,
// pans or measures with cursors looks at a held span, for which the server sends finer rows.
import { echarts } from "nicegui-echart";

const BUCKETS = 600;
const STALE_AFTER_MS = 1000;
const ANSWER_EVERY = 4; // messages: the server holds back when too many aren't painted yet
const MOST_BUSY = 0.6; // share of its time that a page may paint: stop and menus come first
const USUAL_WAIT_MS = 34; // for a frame; a longer one means that the computer doesn't follow
const VALUES_EVERY_MS = 250;
const SHORTEST_S = 0.05; // span that one can zoom to
const LONGEST_S = 4320; // as far back as the server remembers
const ASK_AFTER_MS = 150; // of rest, for finer rows
const DRAG_PX = 6; // less is a click
const OFFSET_JITTER_S = 0.5;

const steps = [1, 2, 2.5, 5, 10];
function niceStep(span) {
  const power = 10 ** Math.floor(Math.log10(span));
  return power * steps.find((step) => step * power >= span * 0.999);
}

function numberText(value) {
  const rounded = Math.abs(value) < 1e-12 ? 0 : Number(value.toPrecision(6)); // a tick at zero is zero
  return String(rounded).replace("-", "−");
}

function fixedText(value, decimals) {
  if (!Number.isFinite(value)) return "—";
  const text = value.toFixed(decimals);
  return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "−");
}

function clock(ms, fine) {
  const parts = { hour: "2-digit", minute: "2-digit", second: "2-digit", hourCycle: "h23" };
  if (fine) parts.fractionalSecondDigits = 2;
  return new Date(ms).toLocaleTimeString(document.documentElement.lang, parts);
}

class Buckets {
  // Lowest and highest value of each of the newest BUCKETS spans of time.
  constructor(width) {
    this.width = width;
    this.points = [];
    this.open = null;
  }
  add(time, low, high, mean) {
    if (mean === null || mean === undefined) return;
    const place = Math.floor(time / this.width);
    if (this.open !== place) {
      this.open = place;
      this.points.push({ time, low, high, sum: mean, count: 1 });
      if (this.points.length > BUCKETS) this.points.shift();
      return;
    }
    const last = this.points[this.points.length - 1];
    last.time = time;
    last.low = Math.min(last.low, low);
    last.high = Math.max(last.high, high);
    last.sum += mean;
    last.count += 1;
  }
}

export default {
  emits: ["painted", "view", "zoomed"],
  template: `
    <div class="trend-box">
      <div class="trend-tools" role="toolbar" :aria-label="words.tools">
        <slot></slot>
        <span v-if="!digits.length" class="group">
          <button type="button" class="control small" :class="{ primary: held }" :disabled="!held" @click="follow">{{ words.live }}</button>
          <button type="button" class="control small" :aria-label="words.zoom_in" :title="words.zoom_in" @click="zoom(0.5)">+</button>
          <button type="button" class="control small" :aria-label="words.zoom_out" :title="words.zoom_out" @click="zoom(2)">−</button>
          <button type="button" class="control small pan" :aria-label="words.earlier" :title="words.earlier" @click="pan(-0.5)">◂</button>
          <button type="button" class="control small pan" :aria-label="words.later" :title="words.later" @click="pan(0.5)">▸</button>
        </span>
        <button v-if="!x && !digits.length" type="button" class="control small" :aria-pressed="String(cursors !== null)" @click="switchCursors">{{ words.cursors }}</button>
        <details class="menu" ref="menu" @click="pressed" @keydown.esc="closeMenu" @focusout="left">
          <summary class="control small">{{ words.more }}</summary>
          <div>
            <slot name="menu"></slot>
            <template v-if="!digits.length">
              <button type="button" class="control quiet small" :aria-pressed="String(peaks)" @click="switchPeaks">{{ words.peaks }}</button>
              <button type="button" class="control quiet small" @click="picture">{{ words.picture }}</button>
              <button type="button" class="control quiet small" @click="table">{{ words.table }}</button>
            </template>
          </div>
        </details>
      </div>
      <ul v-if="digits.length" class="digits">
        <li v-for="(each, index) in digits" :key="each.name" :style="{ borderColor: colour(each.colour) }">{{ each.title }}<b class="number">{{ large[index] ?? "—" }} <span class="unit">{{ each.unit }}</span></b></li>
      </ul>
      <div class="trend-place" ref="place" v-show="!digits.length">
        <div class="trend" ref="plot" role="img" tabindex="0" :aria-label="label" @keydown="key"></div>
        <div v-for="(cursor, index) in shownCursors" class="cursor" role="slider" tabindex="0"
             :style="{ left: cursor.x + 'px' }" :key="index" :aria-label="words.cursor + ' ' + 'AB'[index]"
             :aria-valuenow="cursor.time" :aria-valuemin="cursor.start" :aria-valuemax="cursor.stop" :aria-valuetext="cursor.text"
             @pointerdown.stop="grab(index, $event)" @keydown.stop="moveCursor(index, $event)"><span>{{ "AB"[index] }}</span></div>
        <div v-if="pointed" class="pointed" aria-hidden="true" :style="{ left: pointed.x + 'px' }">
          <ul :class="{ before: pointed.before }"><li class="number">{{ pointed.clock }}</li>
            <li v-for="row in pointed.rows" :key="row.title"><span class="key" :style="{ background: row.colour }"></span>{{ row.title }}<b class="number">{{ row.value }}</b></li></ul>
        </div>
        <div v-if="band" class="zoom-band" :style="{ left: band.left + 'px', width: band.width + 'px' }"></div>
      </div>
      <div v-show="!digits.length" class="scroll" tabindex="0" role="region" :aria-label="words.values">
        <table class="data compact trend-values">
          <thead><tr>
            <th scope="col">{{ heading }}</th>
            <th scope="col" class="number">{{ words.newest }}</th>
            <th scope="col" class="number">{{ words.minimum }}</th>
            <th scope="col" class="number">{{ words.maximum }}</th>
            <th scope="col" class="number">{{ words.mean }}</th>
            <template v-if="peaks"><th scope="col" class="number">{{ words.lowest }}</th><th scope="col" class="number">{{ words.highest }}</th></template>
            <template v-if="cursors"><th scope="col" class="number">A</th><th scope="col" class="number">B</th><th scope="col" class="number">B − A</th></template>
          </tr></thead>
          <tbody>
            <tr v-for="row in values" :key="row.title"><th scope="row"><span class="key" :style="{ background: row.colour }"></span>{{ row.title }}{{ row.unit && words.joint + row.unit }}</th><td v-for="(value, index) in row.values" :key="index" class="number">{{ value }}</td></tr>
          </tbody>
        </table>
      </div>
    </div>`,
  props: {
    label: String,
    words: Object,
    series: Array, // {name, title, unit, grid, axis, colour, dashed, under, decimals}
    x: Object, // horizontal signal of an XY plot, as a series
    digits: { type: Array, default: () => [] }, // signals shown as large numbers, as series
    grids: Array, // {title, floor, second, secondFloor, ends}
    places: Object, // element ids of numbers by signal: {id, decimals}
    region: String, // what goes grey
    name: String, // of files that are saved
  },
  data() {
    return { held: false, cursors: null, shownCursors: [], pointed: null, peaks: false, band: null, large: [], values: [], heading: "" };
  },
  mounted() {
    this.seconds = 10;
    this.buckets = {};
    this.peak = {};
    this.view = null; // {start, stop}: a held span
    this.detail = null; // what the server has sent for one
    this.markers = [];
    this.offset = 0;
    this.newest = 0;
    this.last = performance.now();
    this.received = this.answered = 0;
    this.valuesAt = -Infinity;
    this.statistics = window.torquebench ??= { painted: 0 };
    this.statistics.painted = 0;
    this.statistics.rows = 0;
    this.plot = this.$refs.plot;
    this.chart = echarts.init(this.plot, null, { renderer: "canvas" });
    this.observer = new ResizeObserver(() => {
      this.layout();
      this.chart.resize();
    });
    this.observer.observe(this.plot);
    this.media = window.matchMedia("(prefers-color-scheme: dark)");
    this.onMedia = () => this.layout();
    this.media.addEventListener("change", this.onMedia);
    const place = this.$refs.place;
    place.addEventListener("pointerdown", (event) => this.press(event));
    place.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    place.addEventListener("dblclick", () => this.follow());
    place.addEventListener("pointermove", (event) => this.point(event));
    place.addEventListener("pointerleave", () => this.point(null));
    this.layout();
    this.timer = setInterval(() => this.judge(), 100);
    this.numbers = {};
    this.judge();
  },
  beforeUnmount() {
    clearInterval(this.timer);
    clearTimeout(this.asking);
    this.observer.disconnect();
    this.media.removeEventListener("change", this.onMedia);
    cancelAnimationFrame(this.frame);
    clearTimeout(this.resting);
    this.chart.dispose();
  },
  watch: {
    series: { handler() { this.layout(); }, deep: true },
    grids: { handler() { this.layout(); }, deep: true },
    x: { handler() { this.layout(); }, deep: true },
  },
  methods: {
    colour(name) {
      return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    },
    // All signals whose rows are kept: those drawn, and the horizontal one of an XY plot first.
    signals() {
      return this.x ? [this.x, ...this.series.filter(({ name }) => name !== this.x.name)] : this.series;
    },
    layout() {
      if (!this.chart) return;
      const ink = this.colour("--muted");
      const line = this.colour("--line");
      const narrow = this.plot.clientWidth < 620;
      const count = this.grids.length;
      const height = this.plot.clientHeight || 480;
      const part = (height - 22) / count;
      this.left = narrow ? 58 : 74;
      this.right = this.grids.some((each) => each.second) ? (narrow ? 50 : 70) : 18;
      const grid = [], xAxis = [], yAxis = [], legend = [];
      this.axes = [];
      this.along = { room: this.plot.clientWidth - this.left - this.right, floor: 0.01, low: 0, high: 1 };
      const foot = this.x ? 24 : 0;
      this.grids.forEach((each, place) => {
        const top = place * part + 26;
        grid.push({ left: this.left, right: this.right, top, height: part - 34 - foot });
        xAxis.push(this.x ? {
          type: "value", gridIndex: place, min: 0, max: 1, animation: false, name: this.x.title + (this.x.unit && this.words.joint + this.x.unit),
          nameLocation: "middle", nameGap: 28, nameTextStyle: { color: ink, fontSize: 13 },
          axisLabel: { color: ink, fontSize: 13, formatter: numberText }, axisLine: { onZero: false, lineStyle: { color: line } },
          splitLine: { show: true, lineStyle: { color: line, opacity: 0.5 } },
        } : {
          type: "time", gridIndex: place, min: 0, max: 1, animation: false,
          axisLabel: { show: place === count - 1, color: ink, formatter: (ms) => clock(ms, this.fine), hideOverlap: true, fontSize: 13, showMinLabel: false, showMaxLabel: false },
          axisTick: { show: false }, axisLine: { onZero: false, lineStyle: { color: line } },
          splitLine: { show: true, lineStyle: { color: line, opacity: 0.5 } },
          splitNumber: narrow ? 3 : 7,
        });
        for (const [second, text, floor] of [[false, each.title, each.floor], [true, each.second ?? "", each.secondFloor ?? 1]]) {
          yAxis.push({
            type: "value", gridIndex: place, position: second ? "right" : "left", name: text,
            nameTextStyle: { color: ink, align: second ? "right" : "left", fontSize: 13, padding: second ? [0, narrow ? -44 : -62, 0, 0] : [0, 0, 0, narrow ? -50 : -66] },
            nameGap: 9, min: 0, max: 1, show: text !== "",
            axisLabel: { color: ink, fontSize: 13, formatter: numberText }, axisLine: { show: false, onZero: false },
            splitLine: { show: !second, lineStyle: { color: line, opacity: 0.5 } },
          });
          this.axes.push({ room: part - 34 - foot, floor, low: 0, high: 1, ends: second ? null : (each.ends ?? null), used: text !== "" });
        }
        legend.push({
          itemStyle: { opacity: 0 }, top: top - 27, right: each.second ? this.right + 90 : this.right, data: [], selectedMode: false, itemWidth: 22, itemHeight: 8,
          textStyle: { color: this.colour("--ink"), fontSize: 13 }, show: !narrow,
        });
      });
      const series = this.series.map((each) => ({
        type: "line", name: each.title, data: [], showSymbol: false, animation: false, silent: true,
        xAxisIndex: each.grid, yAxisIndex: 2 * each.grid + (each.axis ?? 0),
        // A broad line beneath and dashes above stay in sight where all of them have one value.
        lineStyle: { width: each.under ? 5 : each.dashed ? 1.4 : 2, type: each.dashed ? "dashed" : "solid", color: this.colour(each.colour), opacity: each.under ? 0.6 : 1 },
        itemStyle: { color: this.colour(each.colour) }, z: each.under ? 1 : each.dashed ? 3 : 2, symbol: "none",
      }));
      const textStyle = { fontFamily: getComputedStyle(document.body).fontFamily };
      this.chart.setOption({ animation: false, textStyle, legend, grid, xAxis, yAxis, series }, { notMerge: true });
      this.drawn = "";
      this.dirty = true;
      this.schedule();
    },
    // The past of a chosen span; increments go on from there.
    reset(seconds, times, low, high, mean, offset) {
      this.seconds = seconds;
      this.offset = offset;
      this.buckets = {};
      this.follow();
      this.rows({ t: times, l: low, h: high, v: mean });
    },
    rows(part) {
      for (const { name } of this.signals()) {
        const values = part.v[name];
        if (!values) continue;
        const low = part.l?.[name] ?? values;
        const high = part.h?.[name] ?? values;
        const buckets = (this.buckets[name] ??= new Buckets(this.seconds / BUCKETS));
        const peak = this.peak[name];
        for (let row = 0; row < values.length; row += 1) {
          buckets.add(part.t[row], low[row], high[row], values[row]);
          if (peak && values[row] !== null) {
            peak.low = Math.min(peak.low, low[row]);
            peak.high = Math.max(peak.high, high[row]);
          }
        }
      }
      if (part.t.length) this.newest = part.t[part.t.length - 1];
      this.dirty = true;
      this.schedule();
    },
    push(part) {
      this.numbers = part.n;
      this.received = part.i;
      const moved = Math.abs(part.o - this.offset) > OFFSET_JITTER_S; // a fast bench
      if (moved && !this.view) this.offset = part.o;
      if (part.t.length) {
        this.last = performance.now();
        this.statistics.rows += part.t.length;
      }
      this.rows(part);
      this.judge();
    },
    marks(markers) {
      this.markers = markers;
      this.dirty = true;
      this.schedule();
    },
    // Finer rows of a held span; an answer to an older question is of no use.
    finer(start, stop, times, low, high, mean) {
      if (!this.view || this.view.start !== start || this.view.stop !== stop) return;
      this.detail = { times, low, high, mean };
      this.dirty = true;
      this.schedule();
    },
    judge() {
      const stale = performance.now() - this.last > STALE_AFTER_MS || document.documentElement.classList.contains("lost");
      document.getElementById(this.region)?.classList.toggle("stale", stale);
    },

    // -- what is looked at ----------------------------------------------------------------------
    shown() {
      return this.view ?? { start: this.newest - this.seconds, stop: this.newest };
    },
    follow() {
      this.view = this.detail = null;
      this.held = false;
      this.cursors = null;
      this.told();
    },
    hold(start, stop) {
      const newest = this.newest;
      const span = Math.min(Math.max(stop - start, SHORTEST_S), LONGEST_S);
      const middle = (start + stop) / 2;
      let first = middle - span / 2;
      if (first + span > newest) first = newest - span;
      this.view = { start: first, stop: first + span };
      this.held = true;
      clearTimeout(this.asking);
      this.asking = setTimeout(() => this.view && this.$emit("view", this.view), ASK_AFTER_MS);
      this.told();
    },
    told() {
      this.$emit("zoomed", this.view);
      this.valuesAt = -Infinity;
      this.dirty = true;
      this.schedule();
    },
    zoom(factor, about = 0.5) {
      const { start, stop } = this.shown();
      const span = (stop - start) * factor;
      const at = start + (stop - start) * about;
      this.hold(at - span * about, at + span * (1 - about));
    },
    pan(share) {
      const { start, stop } = this.shown();
      const by = share * (stop - start);
      this.hold(start + by, stop + by);
    },
    share(event) {
      const box = this.plot.getBoundingClientRect();
      const width = box.width - this.left - this.right;
      return Math.min(Math.max((event.clientX - box.left - this.left) / width, 0), 1);
    },
    wheel(event) {
      if (this.x || (!event.ctrlKey && !this.held)) return; // the page scrolls
      event.preventDefault();
      if (event.shiftKey) this.pan(Math.sign(event.deltaY || event.deltaX) * 0.2);
      else this.zoom(event.deltaY > 0 ? 1.25 : 0.8, this.share(event));
    },
    key(event) {
      const done = {
        "+": () => this.zoom(0.5), "=": () => this.zoom(0.5), "-": () => this.zoom(2),
        ArrowLeft: () => this.pan(-0.2), ArrowRight: () => this.pan(0.2), Escape: () => this.follow(),
      }[event.key];
      if (!done || event.altKey || event.ctrlKey || event.metaKey) return;
      event.preventDefault();
      done();
    },
    // A mouse draws the span to zoom to, or pans with Shift; a finger pans.
    press(event) {
      if (this.x || event.button !== 0 || event.target.closest(".cursor")) return;
      const from = event.clientX;
      const began = this.shown();
      const panning = event.pointerType === "touch" || event.shiftKey;
      const box = this.plot.getBoundingClientRect();
      const width = box.width - this.left - this.right;
      const first = this.share(event);
      const move = (next) => {
        if (Math.abs(next.clientX - from) < DRAG_PX && !this.band) return;
        if (panning) {
          const by = ((from - next.clientX) / width) * (began.stop - began.start);
          this.hold(began.start + by, began.stop + by);
        } else {
          const [low, high] = [first, this.share(next)].sort((a, b) => a - b);
          this.band = { left: this.left + low * width, width: (high - low) * width, low, high };
        }
      };
      const end = () => {
        window.removeEventListener("pointermove", move);
        window.removeEventListener("pointerup", end);
        window.removeEventListener("pointercancel", end);
        if (!this.band) return;
        const span = began.stop - began.start;
        const { low, high } = this.band;
        this.band = null;
        if ((high - low) * width >= DRAG_PX) this.hold(began.start + low * span, began.start + high * span);
      };
      window.addEventListener("pointermove", move);
      window.addEventListener("pointerup", end);
      window.addEventListener("pointercancel", end);
    },

    // -- cursors, peaks, values -----------------------------------------------------------------
    switchCursors() {
      const { start, stop } = this.shown();
      if (this.cursors) {
        this.cursors = null;
      } else {
        this.hold(start, stop);
        this.cursors = [start + (stop - start) / 3, start + (2 * (stop - start)) / 3];
      }
      this.told();
    },
    grab(index, event) {
      const element = event.currentTarget;
      element.setPointerCapture(event.pointerId);
      const move = (next) => {
        const { start, stop } = this.shown();
        this.cursors[index] = start + this.share(next) * (stop - start);
        this.told();
      };
      const end = () => {
        element.removeEventListener("pointermove", move);
        element.removeEventListener("lostpointercapture", end);
      };
      element.addEventListener("pointermove", move);
      element.addEventListener("lostpointercapture", end);
    },
    moveCursor(index, event) {
      const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (!way || event.altKey) return;
      event.preventDefault();
      const { start, stop } = this.shown();
      const by = (way * (stop - start)) / (event.shiftKey ? 20 : 200);
      this.cursors[index] = Math.min(Math.max(this.cursors[index] + by, start), stop);
      this.told();
    },
    switchPeaks() {
      this.peaks = !this.peaks;
      this.peak = {};
      if (this.peaks) for (const { name } of this.series) this.peak[name] = { low: Infinity, high: -Infinity };
      this.told();
    },
    points(name, { start, stop }) {
      // {time, low, high, mean} of a signal within the shown span
      const detail = this.view && this.detail;
      const found = [];
      if (detail?.mean[name]) {
        const { times, low, high, mean } = detail;
        for (let row = 0; row < times.length; row += 1) {
          if (mean[name][row] !== null) found.push({ time: times[row], low: low[name][row], high: high[name][row], mean: mean[name][row] });
        }
        return found;
      }
      for (const point of this.buckets[name]?.points ?? []) {
        if (point.time >= start && point.time <= stop) found.push({ time: point.time, low: point.low, high: point.high, mean: point.sum / point.count });
      }
      return found;
    },
    // Longer distances between points than this are times without a reading.
    longestStep(points) {
      const distances = points.slice(1).map((point, row) => point.time - points[row].time).sort((a, b) => a - b);
      return 3 * (distances[distances.length >> 1] ?? 0);
    },
    // The reading at a time; none in a gap and beyond the ends.
    at(points, time) {
      let best = null;
      for (const point of points) if (best === null || Math.abs(point.time - time) < Math.abs(best.time - time)) best = point;
      return best && Math.abs(best.time - time) <= this.longestStep(points) / 2 ? best.mean : NaN;
    },
    tell(found, { start, stop }) {
      const seconds = numberText(Number((stop - start).toPrecision(4)));
      this.heading = this.words.shown.replace("{seconds}", seconds);
      if (this.cursors) {
        const [a, b] = this.cursors;
        this.heading = this.words.between.replace("{seconds}", fixedText(b - a, 3));
      }
      this.values = this.signals().filter(({ name }) => found[name].length).map((each) => {
        const points = found[each.name];
        let low = Infinity, high = -Infinity, sum = 0;
        for (const point of points) {
          low = Math.min(low, point.low);
          high = Math.max(high, point.high);
          sum += point.mean;
        }
        const text = (value) => fixedText(value, each.decimals);
        const values = [points.at(-1)?.mean ?? NaN, low, high, points.length ? sum / points.length : NaN];
        if (this.peaks) values.push(this.peak[each.name]?.low ?? NaN, this.peak[each.name]?.high ?? NaN);
        if (this.cursors) {
          const [a, b] = this.cursors.map((time) => this.at(points, time));
          values.push(a, b, b - a);
        }
        return { title: each.title, unit: each.unit, colour: this.colour(each.colour), values: values.map(text) };
      });
    },
    placeCursors({ start, stop }) {
      const width = this.plot.clientWidth - this.left - this.right;
      const shown = (this.cursors ?? []).map((time) => ({
        time, start, stop, x: this.left + (width * (time - start)) / (stop - start), text: clock((time + this.offset) * 1000, true),
      }));
      const same = shown.length === this.shownCursors.length && shown.every((each, place) => each.x === this.shownCursors[place].x);
      if (!same) this.shownCursors = shown;
    },

    // -- what the mouse points at: a line through all charts, with the readings at its time -------
    point(event) {
      const free = event?.pointerType === "mouse" && event.buttons === 0 && !this.x;
      this.pointer = free ? this.share(event) : null;
      this.dirty = true;
      this.schedule();
    },
    placePointed(found, { start, stop }) {
      if (typeof this.pointer !== "number") {
        this.pointed = null;
        return;
      }
      const time = start + this.pointer * (stop - start);
      const rows = this.series.map((each) => ({ each, value: this.at(found[each.name], time) })).filter(({ value }) => Number.isFinite(value));
      this.pointed = {
        x: this.left + (this.plot.clientWidth - this.left - this.right) * this.pointer,
        before: this.pointer > 0.5, clock: clock((time + this.offset) * 1000, true),
        rows: rows.map(({ each, value }) => ({ title: each.title, colour: this.colour(each.colour), value: `${fixedText(value, each.decimals)} ${each.unit}` })),
      };
    },

    // -- the menu: closed by a choice, by Escape and by leaving it -------------------------------
    pressed(event) {
      if (event.target.closest("button")) this.$refs.menu.open = false;
    },
    closeMenu() {
      this.$refs.menu.open = false;
      this.$refs.menu.querySelector("summary").focus();
    },
    left(event) {
      if (event.relatedTarget && !this.$refs.menu.contains(event.relatedTarget)) this.$refs.menu.open = false;
    },

    // -- files ----------------------------------------------------------------------------------
    fileName(ending) {
      const stamp = new Date((this.shown().stop + this.offset) * 1000).toISOString().slice(0, 19).replace(/:/g, "-");
      return `${this.name}-${stamp}.${ending}`;
    },
    picture() {
      this.statistics.save(this.fileName("png"), this.chart.getDataURL({ type: "png", pixelRatio: 2, backgroundColor: this.colour("--surface") }));
    },
    table() {
      const shown = this.shown();
      const times = new Map();
      this.signals().forEach(({ name }, place) => {
        for (const point of this.points(name, shown)) {
          const row = times.get(point.time) ?? times.set(point.time, []).get(point.time);
          row[place] = [point.mean, point.low, point.high];
        }
      });
      const quoted = (text) => `"${text.replaceAll('"', '""')}"`;
      const heads = ["time_utc", "bench_time_s"];
      for (const { name, title, unit } of this.signals()) {
        // A spreadsheet would compute a head that begins with an equals sign.
        const head = name.startsWith("=") ? ["computed", ...title.split(" "), unit].filter(Boolean).join("_") : name;
        heads.push(head, `${head}_min`, `${head}_max`);
      }
      const lines = [heads.map(quoted).join(",")];
      for (const [time, row] of [...times].sort((a, b) => a[0] - b[0])) {
        const cells = this.signals().flatMap((_, place) => row[place] ?? ["", "", ""]);
        lines.push([new Date((time + this.offset) * 1000).toISOString(), time, ...cells].join(","));
      }
      this.statistics.saveTable(this.fileName("csv"), lines);
    },

    // -- painting -------------------------------------------------------------------------------
    schedule() {
      if (this.resting !== undefined) return;
      const asked = performance.now();
      this.frame ??= requestAnimationFrame(() => {
        this.frame = undefined;
        if (!this.dirty) return;
        const began = performance.now();
        this.paint();
        // Who waits long for a frame takes the processor from others, such as a press of the stop.
        const late = Math.max(0, began - asked - USUAL_WAIT_MS);
        const rest = (performance.now() - began) * (1 / MOST_BUSY - 1) + late;
        this.resting = setTimeout(() => {
          this.resting = undefined;
          if (this.dirty) this.schedule();
        }, rest);
        if (this.received - this.answered >= ANSWER_EVERY) {
          this.answered = this.received;
          this.$emit("painted", this.received);
        }
      });
    },
    paint() {
      this.dirty = false;
      for (const [signal, place] of Object.entries(this.places)) {
        const element = document.getElementById(place.id);
        if (!element) continue;
        const value = this.numbers?.[signal];
        const text = typeof value === "number" ? fixedText(value, place.decimals) : "—";
        if (element.textContent !== text) element.textContent = text;
      }
      if (this.digits.length) {
        this.large = this.digits.map(({ name, decimals }) => fixedText(this.numbers[name] ?? NaN, decimals));
        this.statistics.painted += 1;
        return;
      }
      const shown = this.shown();
      const span = shown.stop - shown.start;
      this.fine = span < 5;
      const envelope = span > 120 && !this.x;
      const spans = this.axes.map(() => [Infinity, -Infinity]);
      const found = {};
      const along = this.x && new Map((found[this.x.name] = this.points(this.x.name, shown)).map(({ time, mean }) => [time, mean]));
      const series = this.series.map(({ name, grid, axis }, place) => {
        const points = (found[name] = this.points(name, shown));
        const ends = spans[2 * grid + (axis ?? 0)];
        const data = [];
        const longest = this.longestStep(points);
        let before = Infinity;
        for (const point of points) {
          const ms = along ? along.get(point.time) : (point.time + this.offset) * 1000;
          if (ms === undefined) continue;
          if (point.time - before > longest) data.push([ms, null]); // no line across a gap
          before = point.time;
          if (envelope) data.push([ms, point.low], [ms, point.high]);
          else data.push([ms, point.mean]);
          const [low, high] = envelope ? [point.low, point.high] : [point.mean, point.mean];
          if (low < ends[0]) ends[0] = low;
          if (high > ends[1]) ends[1] = high;
        }
        const held = this.peak[name];
        if (held && held.low <= held.high) {
          ends[0] = Math.min(ends[0], held.low);
          ends[1] = Math.max(ends[1], held.high);
        }
        return { data, markLine: this.lines(place, grid, name, shown) };
      });
      const yAxis = this.scales(spans);
      const ends = along && this.scaled(this.along, [...along.values()].reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]));
      const xAxis = this.grids.map(() => ends ?? { min: (shown.start + this.offset) * 1000, max: (shown.stop + this.offset) * 1000 });
      this.chart.setOption({ xAxis, yAxis, series, ...this.legends(found) }, { silent: true });
      this.placeCursors(shown);
      this.placePointed(found, shown);
      const now = performance.now();
      if (now - this.valuesAt > VALUES_EVERY_MS) {
        this.valuesAt = now;
        this.tell(found, shown);
      }
      this.statistics.painted += 1;
    },
    // The legends name the lines that have a reading; nothing where these are the same as before.
    legends(found) {
      const drawn = this.series.filter(({ name }) => found[name].length);
      const names = drawn.map(({ name }) => name).join();
      if (names === this.drawn) return {};
      this.drawn = names;
      return { legend: this.grids.map((_, place) => ({ data: drawn.filter(({ grid }) => grid === place).map(({ title }) => title) })) };
    },
    // Held peaks of a signal; markers stand on the first signal of each chart.
    lines(place, grid, name, { start, stop }) {
      const data = [];
      const held = this.peak[name];
      if (held && held.low <= held.high) {
        for (const value of [held.low, held.high]) data.push({ yAxis: value, label: { show: false }, lineStyle: { color: this.colour(this.series[place].colour), type: "dotted", width: 1.2 } });
      }
      if (!this.x && this.series.findIndex((each) => each.grid === grid) === place) {
        for (const marker of this.markers) {
          if (marker.time < start || marker.time > stop) continue;
          data.push({ xAxis: (marker.time + this.offset) * 1000, label: { show: grid === 0, formatter: marker.note, position: "insideEndTop", color: this.colour("--ink"), fontSize: 13 }, lineStyle: { color: this.colour("--ink"), type: "solid", width: 1 } });
        }
      }
      return { symbol: "none", silent: true, animation: false, data };
    },
    scales(spans) {
      const found = [];
      for (let place = 0; place < this.axes.length; place += 2) {
        const pair = [this.axes[place], this.axes[place + 1]];
        const both = pair.every((axis, side) => axis.used && spans[place + side][0] <= spans[place + side][1]);
        const aligned = both && this.grids[place / 2].aligned && !pair[0].ends;
        if (aligned) found.push(...this.alignedScales(pair, [spans[place], spans[place + 1]]));
        else pair.forEach((axis, side) => found.push(this.scaled(axis, spans[place + side])));
      }
      return found;
    },
    scaled(axis, [low, high]) {
      // Whole steps, and narrower only when much too wide: a scale that trembles can't be read.
      if (axis.ends) return this.whole(axis, axis.ends[0], axis.ends[1]);
      if (low > high) return { min: axis.low, max: axis.high };
      // A value that stands still in a unit without a floor, as a power at rest, has a scale, too.
      const middle = low / 2 + high / 2;
      const span = Math.min(Math.max((high - low) * 1.02, axis.floor, 1e-3 * Math.abs(middle)) || 1, 1e300);
      const found = this.closest(middle - span / 2, middle + span / 2, this.mostParts(axis));
      const fits = low >= axis.low && high <= axis.high && axis.high - axis.low <= this.mostParts(axis) * axis.step * 1.001;
      if (!fits || axis.high - axis.low > 2.1 * (found.max - found.min)) {
        Object.assign(axis, { low: found.min, high: found.max, step: found.interval });
      }
      return { min: axis.low, max: axis.high, interval: axis.step };
    },
    mostParts(axis) {
      return Math.max(2, Math.min(8, Math.floor(axis.room / 30)));
    },
    closest(low, high, most) {
      // The tightest ends that are whole steps, of no more steps than have room; ±2000 end at ±2500.
      let best = null;
      for (let step = niceStep((high - low) / most), tried = 0; tried < 5; step = niceStep(step * 1.01), tried += 1) {
        const below = Math.floor(low / step + 0.01), above = Math.ceil(high / step - 0.01);
        const [min, max] = [below * step, above * step];
        if (above - below <= most && (!best || max - min < (best.max - best.min) * 0.999)) best = { min, max, interval: step };
      }
      return best;
    },
    whole(axis, min, max) {
      // The most equal parts that are round numbers and leave room for their labels.
      for (let parts = this.mostParts(axis); parts > 1; parts -= 1) {
        const interval = (max - min) / parts;
        if (Math.abs(niceStep(interval) - interval) < 1e-9 * interval) return { min, max, interval };
      }
      return { min, max, interval: (max - min) / 2 };
    },
    alignedScales(axes, spans) {
      // The same number of steps below and above zero on either side.
      const wanted = axes.map((axis, side) => {
        const low = Math.min(spans[side][0], 0);
        const high = Math.max(spans[side][1], 0);
        const step = niceStep(Math.max(high - low, axis.floor) / 4);
        return { step, below: Math.ceil(-low / step - 0.01), above: Math.ceil(high / step - 0.01) };
      });
      const below = Math.max(...wanted.map((each) => each.below));
      const above = Math.max(...wanted.map((each) => each.above), below ? 0 : 1);
      const inside = (axis, side) => spans[side][0] >= axis.low && spans[side][1] <= axis.high;
      const wide = (axis, side) => axis.high - axis.low > 2.1 * (below + above) * wanted[side].step;
      const kept = axes.every((axis, side) => axis.step && inside(axis, side) && !wide(axis, side));
      if (!kept) axes.forEach((axis, side) => Object.assign(axis, { low: -below * wanted[side].step, high: above * wanted[side].step, step: wanted[side].step }));
      return axes.map((axis) => ({ min: axis.low, max: axis.high, interval: axis.step }));
    },
  },
};
