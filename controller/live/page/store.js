// Keeps the last rows of a run, column by column, so that any stretch of them is one view.

const HEAD = 16; // bytes of a message before its columns: first row, rows, channels

const MEAN_S = 0.02; // of the velocity: one encoder count within a sample is a spike that hides the motion

export class Store {
  // capacity: rows that are kept; channels: names of the columns besides the time; rate: rows per second
  constructor(capacity, channels, rate = 1000) {
    this.meanRows = Math.max(1, Math.round(MEAN_S * rate));
    this.capacity = capacity;
    this.room = Math.max(2 * capacity, capacity + 20000);
    this.channels = channels;
    this.time = new Float64Array(this.room);
    this.columns = Object.fromEntries(channels.map((name) => [name, new Float32Array(this.room)]));
    this.columns.velocity_mean = new Float32Array(this.room);
    this.length = 0;
    this.next = NaN; // number of the row that comes next
    this.gaps = 0; // rows that never came
  }

  // Take a message of the server, as `frames.py` packs it.
  take(buffer) {
    const head = new DataView(buffer, 0, HEAD);
    const first = head.getFloat64(0, true), count = head.getUint32(8, true);
    if (first > this.next) this.gaps += first - this.next;
    this.next = first + count;
    if (this.length + count > this.room) this.forget(count);
    this.time.set(new Float64Array(buffer, HEAD, count), this.length);
    let offset = HEAD + 8 * count;
    for (const name of this.channels) {
      this.columns[name].set(new Float32Array(buffer, offset, count), this.length);
      offset += 4 * count;
    }
    this.length += count;
    this.mean(this.length - count);
  }

  // Compute the mean velocity up to each row from `begin` on.
  mean(begin) {
    const { velocity_rad_s: velocity, velocity_mean: mean } = this.columns;
    if (!velocity) return;
    for (let row = begin; row < this.length; row++) {
      let sum = 0;
      const from = Math.max(0, row - this.meanRows + 1);
      for (let k = from; k <= row; k++) sum += velocity[k];
      mean[row] = sum / (row - from + 1);
    }
  }

  forget(count) {
    const kept = Math.min(this.length, Math.max(0, this.capacity - count)), from = this.length - kept;
    for (const column of [this.time, ...Object.values(this.columns)]) column.copyWithin(0, from, this.length);
    this.length = kept;
  }

  get first() { return this.length ? this.time[Math.max(0, this.length - this.capacity)] : 0; }
  get last() { return this.length ? this.time[this.length - 1] : 0; }

  // Index of the first row at `time` or later.
  at(time) {
    let low = 0, high = this.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time[middle] < time) low = middle + 1; else high = middle;
    }
    return low;
  }

  // Rows from `from` to `to` [s], with one more on each side, so that lines reach the edges.
  indices(from, to) {
    return [Math.max(0, this.at(from) - 1), Math.min(this.length, this.at(to) + 1)];
  }

  value(name, index) {
    return this.columns[name][index];
  }
}
