// Where the page's data comes from: its own elements (an exported page), or the routes of the program that serves it.

/** An exported page: every part is a script element of the page, JSON or base64. */
class EmbeddedSource {
  #text(name) {
    const element = document.getElementById(`data-${name}`);
    if (!element) throw new Error(`this page has no ${name}`);
    return element.textContent;
  }
  async json(name) {
    return JSON.parse(this.#text(name));
  }
  async bytes(name) {
    return bytesOf(this.#text(name).trim()).buffer;
  }
}

/** A served page: every part is a route of the same server. What the address says of the token is said again, for browsers that keep no cookie. */
class ServedSource {
  async #get(name) {
    let answer;
    try {
      answer = await fetch(`data/${name}${location.search}`);
    } catch {
      throw new Error('the program that serves this page has ended');
    }
    if (!answer.ok) throw new Error((await answer.text()).trim() || `the server answered ${answer.status}`);
    return answer;
  }
  async json(name) {
    return (await this.#get(name)).json();
  }
  async bytes(name) {
    return (await this.#get(name)).arrayBuffer();
  }
  /** The field of a reconstruction at work, and which version it is. */
  async field() {
    const answer = await this.#get('field');
    return { buffer: await answer.arrayBuffer(), version: Number(answer.headers.get('ETag').replaceAll('"', '')) };
  }
}

/** The source of this page. */
function openSource() {
  return document.getElementById('data-scene') ? new EmbeddedSource() : new ServedSource();
}
