// The connection to the server: opens it again when it breaks, and calls what listens.

export class Link {
  // on: {rows(buffer), text(object), open(), lost()}
  constructor(on) {
    this.on = on;
    this.over = false; // the run has ended: nothing more comes
    this.open();
  }

  open() {
    const query = new URLSearchParams();
    const token = new URLSearchParams(location.search).get("token");
    if (token) query.set("token", token);
    const socket = this.socket = new WebSocket(`ws://${location.host}/rows?${query}`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => this.on.open();
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") this.on.text(JSON.parse(data)); else this.on.rows(data);
    };
    socket.onclose = ({ reason, code }) => {
      this.on.lost(reason);
      if (!this.over && code !== 1008) setTimeout(() => this.open(), 1000);
    };
  }

  send(what) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(what));
  }
}
