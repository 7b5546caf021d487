// What a page can try at servers of this machine: WebSocket, fetch in both modes, event stream, image and form.
// Returns what came of each attempt; `OPEN` and `READ` are what must not happen.
async (bases) => {
  const COMMAND = JSON.stringify({ vx: 0.3, wz: 0 });
  const REQUESTS = [["PUT", "/cmd_vel"], ["POST", "/yahboomd/estop/reset"],
    ["POST", "/yahboomd/moves/start"], ["PUT", "/yahboomd/moves/beat"], ["GET", "/yahboomd/pose"]];
  const attempts = [];
  const attempt = (start) =>
    attempts.push(new Promise((done) => {
      start(done);
      setTimeout(() => done("nothing"), 5000);
    }));

  const socket = (url, base) => attempt((done) => {
    const made = new WebSocket(url);
    made.onopen = () => done(`OPEN websocket ${base}`);
    made.onerror = () => done("refused");
  });

  const script = (url, options, base) => attempt(async (done) => {
    try {
      const answer = await fetch(url, options);
      done(answer.type === "opaque" ? "opaque" : `READ ${answer.status} ${base}`);
    } catch {
      done("refused");
    }
  });

  const events = (url, base) => attempt((done) => {
    const made = new EventSource(url);
    made.onopen = () => done(`OPEN events ${base}`);
    made.onerror = () => done("refused");
  });

  const image = (url) => attempt((done) => {
    const made = new Image();
    made.onload = made.onerror = () => done("image");
    made.src = url;
  });

  // A form of text/plain sends `NAME=VALUE`: here that is JSON.
  const form = (url) => attempt((done) => {
    const frame = document.createElement("iframe");
    const made = document.createElement("form");
    const field = document.createElement("input");
    frame.name = `frame${attempts.length}`;
    frame.onload = () => done("form");
    Object.assign(made, { method: "POST", enctype: "text/plain", target: frame.name, action: url });
    Object.assign(field, { name: '{"x": 1, "y": 2, "theta": 0, "a": "', value: '"}' });
    made.append(field);
    document.body.append(frame, made);
    made.submit();
  });

  for (const base of bases) {
    for (const path of ["/zenoh", "/"]) socket(base.replace("http", "ws") + path, base);
    for (const prefix of ["/rest", ""]) {
      for (const [method, path] of REQUESTS)
        for (const mode of ["cors", "no-cors"])
          for (const headers of [{}, { "X-Yahboomd": "1" }])
            script(base + prefix + path, { method, mode, headers, body: method === "GET" ? undefined : COMMAND }, base);
      events(`${base}${prefix}/yahboomd/*`, base);
      image(`${base}${prefix}/yahboomd/estop/reset?_raw`);
      form(`${base}${prefix}/yahboomd/odometry/set_pose`);
    }
  }
  return Promise.all(attempts);
}
