// The list of events: time and words; a click shows that time.

const MOST = 1000;

export class Events {
  constructor(list, show) {
    this.list = list;
    this.show = show;
    this.marks = [];
  }

  clear() {
    this.marks.length = 0;
    this.list.replaceChildren();
  }

  add(marks) {
    for (const mark of marks) {
      this.marks.push(mark);
      const item = document.createElement("li");
      item.className = mark.kind;
      const time = item.appendChild(document.createElement("time"));
      time.textContent = `${Math.max(0, mark.t).toFixed(2)} s`;
      item.appendChild(document.createElement("span")).textContent = mark.words;
      item.addEventListener("click", () => this.show(mark.t));
      if (this.marks.length === 1) this.list.replaceChildren();
      this.list.prepend(item);
    }
    while (this.marks.length > MOST) {
      this.marks.shift();
      this.list.lastChild.remove();
    }
  }
}
