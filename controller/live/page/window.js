// Which stretch of time is seen: the newest seconds, or a fixed stretch.

export const SPANS = [1, 5, 10, 60];

export class TimeWindow {
  constructor(store) {
    this.store = store;
    this.span = 10;
    this.follows = true;
    this.fixed = [0, 10];
  }

  get stretch() {
    if (!this.follows) return this.fixed;
    const end = Math.max(this.store.last, this.store.first + this.span);
    return [end - this.span, end];
  }

  follow(span = this.span) { this.span = span; this.follows = true; }

  hold() { this.fixed = this.stretch; this.follows = false; }

  show(from, to) {
    if (!(to - from > 0.002)) return;
    this.fixed = [from, to];
    this.follows = false;
  }

  // Zoom by a factor about a time that stays in its place.
  zoom(factor, about) {
    const [from, to] = this.stretch;
    const most = Math.max(1, this.store.last - this.store.first);
    const by = Math.min(factor, (1.2 * most) / (to - from));
    this.show(about - (about - from) * by, about + (to - about) * by);
  }

  shift(seconds) {
    const [from, to] = this.stretch;
    this.show(from + seconds, to + seconds);
  }
}
