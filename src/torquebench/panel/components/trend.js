// The live view's chart and numbers. Rows come in small increments; the browser draws them once a
// frame. Every buffer has a fixed size, so an hour costs no more memory than a minute.
import { echarts } from "nicegui-echart";

const BUCKETS = 600;
const STALE_AFTER_MS = 1000;
const ANSWER_EVERY = 4; // messages: the server holds back when too many aren't painted yet
const MOST_BUSY = 0.6; // share of its time that a page may paint: stop and menus come first

function niceStep(span) {
  const power = 10 ** Math.floor(Math.log10(span));
  const ratio = span / power;
  return power * (ratio <= 1 ? 1 : ratio <= 2 ? 2 : ratio <= 5 ? 5 : 10);
}

function clockText(seconds) {
  if (seconds < -1e-6) return ""; // before the bench was opened
  const whole = Math.floor(seconds + 1e-6);
  const pad = (value) => String(value).padStart(2, "0");
  const hours = Math.floor(whole / 3600);
  const minutes = Math.floor(whole / 60) % 60;
  return `${hours ? hours + ":" : ""}${hours ? pad(minutes) : minutes}:${pad(whole % 60)}`;
}

function numberText(value) {
  return String(Number(value.toPrecision(6))).replace("-", "−");
}

function fixedText(value, decimals) {
  const text = value.toFixed(decimals);
  return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "−");
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
  data(oldest, envelope) {
    const found = [];
    for (const point of this.points) {
      if (point.time < oldest) continue;
      if (envelope) {
        found.push([point.time, point.low], [point.time, point.high]);
      } else {
        found.push([point.time, point.sum / point.count]);
      }
    }
    return found;
  }
}

export default {
  emits: ["painted"],
  template: '<div class="trend" role="img" :aria-label="label"></div>',
  props: {
    label: String,
    series: Array, // {name, title, grid, colour, dashed, axis}
    grids: Array, // {title, floor, second}
    places: Object, // element ids of numbers by signal: {id, decimals}
    region: String, // what goes grey
  },
  mounted() {
    this.seconds = 10;
    this.buckets = {};
    this.hidden = new Set();
    this.newest = 0;
    this.last = performance.now();
    this.received = this.answered = 0;
    this.statistics = window.torquebench ??= { painted: 0 };
    this.statistics.painted = 0;
    this.statistics.rows = 0;
    this.chart = echarts.init(this.$el, null, { renderer: "canvas" });
    this.observer = new ResizeObserver(() => {
      this.layout();
      this.chart.resize();
    });
    this.observer.observe(this.$el);
    this.media = window.matchMedia("(prefers-color-scheme: dark)");
    this.onMedia = () => this.layout();
    this.media.addEventListener("change", this.onMedia);
    this.layout();
    this.timer = setInterval(() => this.judge(), 100);
    this.numbers = {};
    this.judge();
  },
  beforeUnmount() {
    clearInterval(this.timer);
    this.observer.disconnect();
    this.media.removeEventListener("change", this.onMedia);
    cancelAnimationFrame(this.frame);
    clearTimeout(this.resting);
    this.chart.dispose();
  },
  methods: {
    colour(name) {
      return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    },
    layout() {
      const ink = this.colour("--muted");
      const line = this.colour("--line");
      const narrow = this.$el.clientWidth < 620;
      const count = this.grids.length;
      const height = this.$el.clientHeight || 480;
      const part = (height - 34) / count;
      const grid = [], xAxis = [], yAxis = [];
      this.axes = [];
      this.grids.forEach((each, place) => {
        const top = place * part + 26;
        grid.push({ left: narrow ? 54 : 74, right: narrow ? 44 : 64, top, height: part - 36 });
        xAxis.push({
          type: "value", gridIndex: place, min: 0, max: 1, animation: false,
          axisLabel: { show: place === count - 1, color: ink, formatter: clockText, hideOverlap: true, fontSize: 13, showMinLabel: false, showMaxLabel: false },
          axisTick: { show: false }, axisLine: { lineStyle: { color: line } },
          splitLine: { show: true, lineStyle: { color: line, opacity: 0.5 } },
          splitNumber: narrow ? 4 : 8,
        });
        for (const [second, text, floor] of [[false, each.title, each.floor], [true, each.second ?? "", each.secondFloor ?? 1]]) {
          yAxis.push({
            type: "value", gridIndex: place, position: second ? "right" : "left", name: text,
            nameTextStyle: { color: ink, align: second ? "right" : "left", fontSize: 13, padding: second ? [0, -20, 0, 0] : [0, 0, 0, narrow ? -40 : -60] },
            nameGap: 8, min: 0, max: 1, show: text !== "",
            axisLabel: { color: ink, fontSize: 13, formatter: numberText }, axisLine: { show: false, onZero: false },
            splitNumber: 3, splitLine: { show: !second, lineStyle: { color: line, opacity: 0.5 } },
          });
          this.axes.push({ floor, low: 0, high: 1 });
        }
      });
      const series = this.series.map((each) => ({
        type: "line", name: each.title, data: [], showSymbol: false, animation: false, silent: true,
        xAxisIndex: each.grid, yAxisIndex: 2 * each.grid + (each.axis ?? 0),
        lineStyle: { width: each.dashed ? 1.4 : 2, type: each.dashed ? "dashed" : "solid", color: this.colour(each.colour) },
        itemStyle: { color: this.colour(each.colour) }, z: each.dashed ? 2 : 3,
      }));
      const textStyle = { fontFamily: getComputedStyle(document.body).fontFamily };
      this.chart.setOption({ animation: false, textStyle, grid, xAxis, yAxis, series }, { notMerge: true });
      this.dirty = true;
      this.schedule();
    },
    // The past of a chosen window; increments go on from there.
    reset(seconds, times, low, high, mean) {
      this.seconds = seconds;
      this.buckets = {};
      this.rows({ t: times, l: low, h: high, v: mean });
    },
    rows(part) {
      for (const { name } of this.series) {
        const values = part.v[name];
        if (!values) continue;
        const low = part.l?.[name] ?? values;
        const high = part.h?.[name] ?? values;
        const buckets = (this.buckets[name] ??= new Buckets(this.seconds / BUCKETS));
        for (let row = 0; row < values.length; row += 1) buckets.add(part.t[row], low[row], high[row], values[row]);
      }
      if (part.t.length) this.newest = part.t[part.t.length - 1];
      this.dirty = true;
      this.schedule();
    },
    push(part) {
      this.numbers = part.n;
      this.received = part.i;
      if (part.t.length) {
        this.last = performance.now();
        this.statistics.rows += part.t.length;
      }
      this.rows(part);
      this.judge();
    },
    toggle(names, shown) {
      for (const name of names) shown ? this.hidden.delete(name) : this.hidden.add(name);
      this.dirty = true;
      this.schedule();
    },
    judge() {
      const stale = performance.now() - this.last > STALE_AFTER_MS || document.documentElement.classList.contains("lost");
      document.getElementById(this.region)?.classList.toggle("stale", stale);
    },
    schedule() {
      if (this.resting !== undefined) return;
      this.frame ??= requestAnimationFrame(() => {
        this.frame = undefined;
        if (!this.dirty) return;
        const began = performance.now();
        this.paint();
        const rest = (performance.now() - began) * (1 / MOST_BUSY - 1);
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
      const oldest = this.newest - this.seconds;
      const envelope = this.seconds > 120;
      const spans = this.axes.map(() => [Infinity, -Infinity]);
      const series = this.series.map(({ name, grid, axis }) => {
        const data = this.hidden.has(name) ? [] : (this.buckets[name]?.data(oldest, envelope) ?? []);
        const span = spans[2 * grid + (axis ?? 0)];
        for (const [, value] of data) {
          if (value < span[0]) span[0] = value;
          if (value > span[1]) span[1] = value;
        }
        return { data };
      });
      const yAxis = this.axes.map((each, place) => this.scaled(each, spans[place]));
      const xAxis = this.grids.map(() => ({ min: oldest, max: this.newest }));
      this.chart.setOption({ xAxis, yAxis, series }, { silent: true });
      this.statistics.painted += 1;
    },
    scaled(axis, [low, high]) {
      // Whole steps, and narrower only when much too wide: a scale that trembles can't be read.
      if (low > high) return { min: axis.low, max: axis.high };
      const middle = (low + high) / 2;
      const span = Math.max(high - low, axis.floor);
      const step = niceStep(span / 2);
      const bottom = Math.floor((middle - span / 2) / step) * step;
      const top = Math.ceil((middle + span / 2) / step) * step;
      const fits = low >= axis.low && high <= axis.high;
      if (!fits || axis.high - axis.low > 2.5 * (top - bottom)) {
        axis.low = bottom;
        axis.high = top;
      }
      return { min: axis.low, max: axis.high, interval: niceStep((axis.high - axis.low) / 3) };
    },
  },
};
