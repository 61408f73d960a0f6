// The conversation with the server: ask for a scan, draw it, ask again. Who draws slowly asks seldom.

const RETRY_MS = 1000;

export class Connection {
  // request(): what is wanted now; draw(answer): shows an answer; state(word): says how it stands.
  constructor(request, draw, state) {
    this.request = request;
    this.draw = draw;
    this.state = state;
    this.open();
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/live`);
    this.socket.onopen = () => {
      this.state("connected");
      this.ask(true);
    };
    this.socket.onclose = () => {
      this.state("no connection");
      setTimeout(() => this.open(), RETRY_MS);
    };
    this.socket.onmessage = (event) => {
      const answer = JSON.parse(event.data);
      // A hidden page draws nothing, but still asks.
      const next = () => { this.draw(answer); this.ask(false); };
      if (document.hidden) setTimeout(next, 500);
      else requestAnimationFrame(next);
    };
  }

  // fresh: somebody did something, the answer shall not wait for news.
  ask(fresh) {
    if (this.socket.readyState === WebSocket.OPEN) {
      this.socket.send(JSON.stringify({ ...this.request(), fresh }));
    }
  }
}

export async function post(path, content) {
  try {
    const answer = await fetch(path, {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(content),
    });
    if (answer.ok) return await answer.json();
    return { error: await answer.text() };
  } catch (error) {
    return { error: `no connection (${error.message})` };
  }
}

export async function get(path) {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}
