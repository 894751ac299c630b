// The torque of one servo as sound: without its mean, with a limited loudness.

const RATE = 8000, LEAD_S = 0.12, LOUDNESS = 0.2, SHARP = 4; // loudness of 1

export class Sound {
  constructor() {
    this.servo = null; // the one that is heard
  }

  toggle(servo) {
    this.servo = this.servo === servo ? null : servo;
    if (!this.context) {
      this.context = new AudioContext();
      this.gain = new GainNode(this.context, { gain: LOUDNESS });
      this.gain.connect(this.context.destination);
    }
    if (this.servo) this.context.resume(); else this.context.suspend();
    this.next = 0;
    this.slow = this.last = NaN;
  }

  // Play the rows of the store from number `begin` on; limit: the largest torque [N·m].
  feed(servo, begin, limit) {
    const { store } = servo, count = Math.min(store.length, store.next - begin);
    if (servo !== this.servo || count <= 0) return;
    const torque = store.columns.torque_nm.subarray(store.length - count, store.length);
    const time = store.time, step = (time[store.length - 1] - time[store.length - count]) / Math.max(1, count - 1) || 1e-3;
    const each = Math.max(1, Math.round(RATE * step));
    const wave = new Float32Array(count * each);
    if (Number.isNaN(this.slow)) this.slow = this.last = torque[0];
    for (let k = 0, at = 0; k < count; k++) {
      this.slow += (torque[k] - this.slow) * 0.05; // follows below 8 Hz at 1 kHz
      for (let part = 1; part <= each; part++) wave[at++] = Math.tanh((SHARP * (this.last + ((torque[k] - this.last) * part) / each - this.slow)) / limit);
      this.last = torque[k];
    }
    this.play(wave);
  }

  play(wave) {
    const { context } = this, buffer = new AudioBuffer({ length: wave.length, sampleRate: RATE });
    buffer.copyToChannel(wave, 0);
    const source = new AudioBufferSourceNode(context, { buffer });
    source.connect(this.gain);
    const now = context.currentTime;
    if (this.next < now || this.next > now + 4 * LEAD_S) this.next = now + LEAD_S;
    source.start(this.next);
    this.next += buffer.duration;
  }
}
