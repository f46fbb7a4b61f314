// The order in which Gaussians are drawn, far to near, found beside the page so that it never waits.

/**
 * Makes a function that orders Gaussians by their depth. It stands by itself: its text is the worker's program.
 *
 * @param position x, y, z of every Gaussian, metres.
 * @returns Of a row (x, y, z, offset) that gives depth, and the nearest depth drawn: the numbers of what lies beyond it, farthest first.
 */
function makeSorter(position) {
  const count = position.length / 3;
  const depth = new Float32Array(count);
  // A positive float's bits order as the float does, so two passes over 16 bits each sort exactly.
  const bits = new Uint32Array(depth.buffer);
  const low = new Uint32Array(65536), high = new Uint32Array(65536), half = new Uint32Array(count);
  const starts = (histogram) => {
    let sum = 0;
    for (let i = 65535; i >= 0; i--) {
      const here = histogram[i];
      histogram[i] = sum;
      sum += here;
    }
  };
  return (row, near) => {
    low.fill(0);
    high.fill(0);
    let drawn = 0;
    for (let i = 0; i < count; i++) {
      const z = row[0] * position[3 * i] + row[1] * position[3 * i + 1] + row[2] * position[3 * i + 2] + row[3];
      depth[i] = z > near ? z : 0;
      if (depth[i] > 0) {
        low[bits[i] & 65535]++;
        high[bits[i] >>> 16]++;
        drawn++;
      }
    }
    starts(low);
    starts(high);
    // Backwards: of equal depths the first is nearest, as it is where corf blends front to back.
    for (let i = count - 1; i >= 0; i--) if (depth[i] > 0) half[low[bits[i] & 65535]++] = i;
    const order = new Uint32Array(drawn);
    for (let k = 0; k < drawn; k++) order[high[bits[half[k]] >>> 16]++] = half[k];
    return order;
  };
}

/** Orders Gaussians in a worker, one request at a time; of requests that come meanwhile the last one counts. */
class DepthOrder {
  #url;
  #worker;
  #busy = null;
  #waiting = null;
  #near;

  /** `done` is called with every new order and the request that it answers. */
  constructor(position, near, done) {
    this.#near = near;
    const program = `${makeSorter};let sort;onmessage=({data})=>{if(data.position)sort=makeSorter(data.position);` +
      'else{const order=sort(data.row,data.near);postMessage({order,row:data.row},[order.buffer]);}};';
    this.#url = URL.createObjectURL(new Blob([program], { type: 'text/javascript' }));
    this.#worker = new Worker(this.#url);
    this.#worker.onmessage = ({ data }) => {
      this.#busy = null;
      done(data.order, data.row);
      if (this.#waiting) this.#send(this.#waiting);
    };
    this.#worker.postMessage({ position });
  }

  /** Asks for the order seen along a row of camera_from_world. */
  request(row) {
    if (!this.#busy) this.#send(row);
    else if (this.#busy.join() !== row.join()) this.#waiting = row;
    else this.#waiting = null;
  }

  /** Ends the worker. */
  close() {
    this.#worker.terminate();
    URL.revokeObjectURL(this.#url);
  }

  #send(row) {
    this.#busy = row;
    this.#waiting = null;
    this.#worker.postMessage({ row, near: this.#near });
  }
}
