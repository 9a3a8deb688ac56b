"use strict";
// One cursor for all plots and the map. The page is complete without this.
(function () {
  const flight = JSON.parse(document.getElementById("flight").textContent);
  const along = flight.along_m;
  const last = along.length - 1;
  const byId = (id) => document.getElementById(id);
  const all = (selector) => Array.from(document.querySelectorAll(selector));
  document.documentElement.classList.remove("no-script");

  const cursors = all(".plot line.cursor");
  const marker = byId("marker");
  const slider = byId("slider");
  const map = byId("map");
  const rows = all("tr.jump");
  let now = 0;

  // Index of the entry nearest to a value of an ascending list.
  function nearest(list, value) {
    let low = 0, high = list.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (list[middle] <= value) low = middle; else high = middle;
    }
    return value - list[low] <= list[high] - value ? low : high;
  }

  const number = (value, digits) => value === null ? "unknown" : value.toFixed(digits);
  const two = (value) => String(value).padStart(2, "0");
  function clock(seconds) {
    const whole = Math.round(seconds);
    return two(Math.floor(whole / 60)) + ":" + two(whole % 60);
  }
  function heading(degrees) {
    if (degrees === null) return "unknown";
    return String(((Math.round(degrees) % 360) + 360) % 360).padStart(3, "0") + "°";
  }
  const shown = {
    time: (i) => clock(flight.time_s[i]),
    eta: (i) => new Date(flight.start_ms + 1000 * flight.time_s[i]).toISOString().slice(11, 19) + "Z",
    along: (i) => (along[i] / 1000).toFixed(2) + " km",
    altitude: (i) => number(flight.altitude_m[i], 0) + " m",
    height: (i) => number(flight.height_m[i], 1) + " m",
    speed: (i) => number(flight.speed_mps[i], 1) + " m/s",
    climb: (i) => number(flight.climb_mps[i], 1) + " m/s",
    bank: (i) => number(flight.bank_deg[i], 1) + "°",
    true: (i) => heading(flight.heading_deg[i]),
    grid: (i) => heading(flight.grid_deg[i]),
    magnetic: (i) => heading(flight.heading_deg[i] - flight.declination_deg),
    cost: (i) => number(flight.cost[i], 2),
    place: (i) => flight.latitude_deg === undefined ? "" :
      flight.latitude_deg[i].toFixed(5) + "," + flight.longitude_deg[i].toFixed(5),
  };
  const fields = all("dd[data-field]");

  function show(index) {
    now = Math.max(0, Math.min(last, index));
    const x = 1000 * (along[last] > 0 ? along[now] / along[last] : 0);
    for (const line of cursors) {
      line.setAttribute("x1", x.toFixed(2));
      line.setAttribute("x2", x.toFixed(2));
    }
    marker.setAttribute("transform", "translate(" + flight.x[now] + " " + flight.y[now] + ")");
    for (const field of fields) field.textContent = shown[field.dataset.field](now);
    slider.value = String(now);
    slider.setAttribute("aria-valuetext", clock(flight.time_s[now]));
    for (const row of rows) {
      row.classList.toggle("now", row.dataset.until !== undefined &&
        flight.time_s[now] >= Number(row.dataset.time) && flight.time_s[now] < Number(row.dataset.until));
    }
  }

  for (const svg of all(".plot svg")) {
    const follow = (event) => {
      const box = svg.getBoundingClientRect();
      show(nearest(along, (event.clientX - box.left) / box.width * along[last]));
    };
    svg.addEventListener("pointermove", follow);
    svg.addEventListener("pointerdown", follow);
  }
  slider.max = String(last);
  slider.addEventListener("input", () => show(Number(slider.value)));
  for (const row of rows) {
    row.addEventListener("click", () => show(nearest(flight.time_s, Number(row.dataset.time))));
  }

  // The map: cursor at the nearest place of the flight, zoom by buttons, pan by dragging.
  const whole = map.getAttribute("viewBox").split(" ").map(Number);
  let view = whole.slice();
  function placeOf(event) {
    const point = map.createSVGPoint();
    point.x = event.clientX;
    point.y = event.clientY;
    return point.matrixTransform(map.getScreenCTM().inverse());
  }
  function look() {
    view[2] = Math.min(view[2], whole[2]);
    view[3] = Math.min(view[3], whole[3]);
    view[0] = Math.max(whole[0], Math.min(view[0], whole[0] + whole[2] - view[2]));
    view[1] = Math.max(whole[1], Math.min(view[1], whole[1] + whole[3] - view[3]));
    map.setAttribute("viewBox", view.map((value) => value.toFixed(3)).join(" "));
    map.style.touchAction = view[2] < whole[2] ? "none" : "pan-y";
  }
  function zoom(factor) {
    const x = flight.x[now], y = flight.y[now];
    const isInside = x >= view[0] && x <= view[0] + view[2] && y >= view[1] && y <= view[1] + view[3];
    const cx = isInside ? x : view[0] + view[2] / 2, cy = isInside ? y : view[1] + view[3] / 2;
    view = [cx - view[2] * factor / 2, cy - view[3] * factor / 2, view[2] * factor, view[3] * factor];
    look();
  }
  let drag = null;
  map.addEventListener("pointerdown", (event) => { drag = placeOf(event); });
  window.addEventListener("pointerup", () => { drag = null; });
  map.addEventListener("pointermove", (event) => {
    const place = placeOf(event);
    if (drag !== null && view[2] < whole[2]) {
      view[0] += drag.x - place.x;
      view[1] += drag.y - place.y;
      look();
      return;
    }
    let best = now, bestSquare = Infinity;
    for (let i = 0; i <= last; ++i) {
      const dx = flight.x[i] - place.x, dy = flight.y[i] - place.y;
      if (dx * dx + dy * dy < bestSquare) { bestSquare = dx * dx + dy * dy; best = i; }
    }
    show(best);
  });
  byId("zoom-in").addEventListener("click", () => zoom(0.5));
  byId("zoom-out").addEventListener("click", () => zoom(2));
  byId("zoom-all").addEventListener("click", () => { view = whole.slice(); look(); });

  // #t=SECONDS opens the report with the cursor there.
  function fromAddress() {
    const match = /^#t=([0-9]+(\.[0-9]+)?)$/.exec(location.hash);
    if (match !== null) show(nearest(flight.time_s, Number(match[1])));
  }
  window.addEventListener("hashchange", fromAddress);
  show(0);
  fromAddress();
})();
