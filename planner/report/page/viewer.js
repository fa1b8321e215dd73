// Three-dimensional view without WebGL: triangles into a depth buffer, lines over it with their depth tested, so that it looks
// the same on every machine and prints. Frame: part, mm. Orthographic.
function makeView(box, data, scale) {
  'use strict';
  const canvas = box.querySelector('canvas'), read = box.querySelector('.read');
  const lo = data.box[0], hi = data.box[1];
  const centre = [0, 1, 2].map(i => (lo[i] + hi[i]) / 2);
  const diagonal = Math.hypot(hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2]) || 1;
  const state = {yaw: -0.65, pitch: 0.62, zoom: 1, pan: [0, 0], about: centre.slice(), exaggeration: data.exaggeration || 1,
    show: {part: true, outline: true, nominal: true, adapted: true, path: true, approach: false, cloud: !data.edges.length}, edge: -1, mark: null};

  function bytes(text) {
    const raw = atob(text), out = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; ++i) out[i] = raw.charCodeAt(i);
    return out.buffer;
  }
  function unpack(text) {  // 16 bits over the box
    const q = new Uint16Array(bytes(text)), p = new Float32Array(q.length);
    for (let i = 0; i < q.length; ++i) p[i] = lo[i % 3] + (hi[i % 3] - lo[i % 3]) * q[i] / 65535;
    return p;
  }
  let mesh = null;
  if (data.mesh) {
    const v = unpack(data.mesh.v), t = new Uint32Array(bytes(data.mesh.t)), n = t.length / 3;
    const face = new Float32Array(n * 3), around = new Map();
    for (let i = 0; i < n; ++i) {
      const a = 3 * t[3 * i], b = 3 * t[3 * i + 1], c = 3 * t[3 * i + 2];
      const ux = v[b] - v[a], uy = v[b + 1] - v[a + 1], uz = v[b + 2] - v[a + 2];
      const wx = v[c] - v[a], wy = v[c + 1] - v[a + 1], wz = v[c + 2] - v[a + 2];
      const x = uy * wz - uz * wy, y = uz * wx - ux * wz, z = ux * wy - uy * wx, l = Math.hypot(x, y, z) || 1;
      face[3 * i] = x / l; face[3 * i + 1] = y / l; face[3 * i + 2] = z / l;
      for (let k = 0; k < 3; ++k) {
        const w = t[3 * i + k];
        let list = around.get(w);
        if (!list) around.set(w, list = []);
        list.push(i, l);
      }
    }
    const corner = new Float32Array(n * 9);  // a normal for each corner, smooth across angles below 32 degrees
    for (let i = 0; i < n; ++i) for (let k = 0; k < 3; ++k) {
      let x = 0, y = 0, z = 0;
      const list = around.get(t[3 * i + k]);
      for (let m = 0; m < list.length; m += 2) {
        const j = 3 * list[m], d = face[j] * face[3 * i] + face[j + 1] * face[3 * i + 1] + face[j + 2] * face[3 * i + 2];
        if (d > 0.85) { x += face[j] * list[m + 1]; y += face[j + 1] * list[m + 1]; z += face[j + 2] * list[m + 1]; }
      }
      const l = Math.hypot(x, y, z) || 1;
      corner[9 * i + 3 * k] = x / l; corner[9 * i + 3 * k + 1] = y / l; corner[9 * i + 3 * k + 2] = z / l;
    }
    mesh = {v, t, n, face, corner};
  }
  const cloud = data.cloud ? unpack(data.cloud) : null;

  function axes() {  // rows: right, up, towards the eye
    const cy = Math.cos(state.yaw), sy = Math.sin(state.yaw), cp = Math.cos(state.pitch), sp = Math.sin(state.pitch);
    return [[cy, sy, 0], [-sy * sp, cy * sp, cp], [sy * cp, -cy * cp, sp]];
  }
  let fit = [diagonal, diagonal];  // mm that have to fit into the width and height at zoom 1
  function refit() {
    const [R, U] = axes();
    fit = [R, U].map(a => 1.16 * Math.max(0.2 * diagonal, [0, 1, 2].reduce((sum, i) => sum + Math.abs(a[i]) * (hi[i] - lo[i]), 0)));
  }
  let frame = null, depth = null;
  function draw(fine) {
    const cssW = canvas.clientWidth, cssH = canvas.clientHeight;
    if (!cssW || !cssH) return;
    const ratio = fine ? Math.max(1.5, window.devicePixelRatio || 1) : 1;
    const W = Math.round(cssW * ratio), H = Math.round(cssH * ratio);
    if (canvas.width !== W || canvas.height !== H) { canvas.width = W; canvas.height = H; frame = null; }
    const ctx = canvas.getContext('2d');
    if (!frame || frame.width !== W || frame.height !== H) { frame = ctx.createImageData(W, H); depth = new Float32Array(W * H); }
    depth.fill(-1e30);
    const px = new Uint32Array(frame.data.buffer);
    px.fill(0);
    const [R, U, E] = axes(), s = state.zoom * Math.min(W / fit[0], H / fit[1]);
    const ox = W / 2 + state.pan[0] * ratio, oy = H / 2 + state.pan[1] * ratio, c = state.about;
    const project = (x, y, z) => {
      x -= c[0]; y -= c[1]; z -= c[2];
      return [ox + s * (R[0] * x + R[1] * y + R[2] * z), oy - s * (U[0] * x + U[1] * y + U[2] * z), E[0] * x + E[1] * y + E[2] * z];
    };
    if (mesh && state.show.part) {
      const v = mesh.v, m = v.length / 3, sx = new Float32Array(m), sy = new Float32Array(m), sz = new Float32Array(m);
      for (let i = 0; i < m; ++i) { const q = project(v[3 * i], v[3 * i + 1], v[3 * i + 2]); sx[i] = q[0]; sy[i] = q[1]; sz[i] = q[2]; }
      const L = [0.35 * R[0] + 0.45 * U[0] + 0.82 * E[0], 0.35 * R[1] + 0.45 * U[1] + 0.82 * E[1], 0.35 * R[2] + 0.45 * U[2] + 0.82 * E[2]];
      const n = mesh.corner, t = mesh.t;
      for (let i = 0; i < mesh.n; ++i) {
        const f = 3 * i;
        if (mesh.face[f] * E[0] + mesh.face[f + 1] * E[1] + mesh.face[f + 2] * E[2] <= 0) continue;
        const a = t[f], b = t[f + 1], d = t[f + 2];
        const x0 = sx[a], y0 = sy[a], x1 = sx[b], y1 = sy[b], x2 = sx[d], y2 = sy[d];
        const left = Math.max(0, Math.ceil(Math.min(x0, x1, x2) - 0.5)), right = Math.min(W - 1, Math.floor(Math.max(x0, x1, x2) + 0.5));
        const top = Math.max(0, Math.ceil(Math.min(y0, y1, y2) - 0.5)), low = Math.min(H - 1, Math.floor(Math.max(y0, y1, y2) + 0.5));
        if (left > right || top > low) continue;
        const area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0);
        if (Math.abs(area) < 1e-9) continue;
        const k = 9 * i, inv = 1 / area;
        const i0 = n[k] * L[0] + n[k + 1] * L[1] + n[k + 2] * L[2], i1 = n[k + 3] * L[0] + n[k + 4] * L[1] + n[k + 5] * L[2],
          i2 = n[k + 6] * L[0] + n[k + 7] * L[1] + n[k + 8] * L[2];
        for (let y = top; y <= low; ++y) for (let x = left; x <= right; ++x) {
          const w1 = ((x - x0) * (y2 - y0) - (x2 - x0) * (y - y0)) * inv, w2 = ((x1 - x0) * (y - y0) - (x - x0) * (y1 - y0)) * inv, w0 = 1 - w1 - w2;
          if (w0 < -1e-4 || w1 < -1e-4 || w2 < -1e-4) continue;
          const z = w0 * sz[a] + w1 * sz[b] + w2 * sz[d], at = y * W + x;
          if (z <= depth[at]) continue;
          depth[at] = z;
          const g = 0.42 + 0.58 * Math.max(0, w0 * i0 + w1 * i1 + w2 * i2);
          px[at] = 0xff000000 | (Math.min(255, 233 * g) << 16) | (Math.min(255, 226 * g) << 8) | Math.min(255, 219 * g);
        }
      }
    }
    const bias = diagonal * 0.006;
    if (cloud && state.show.cloud) for (let i = 0; i < cloud.length; i += 3) {
      const q = project(cloud[i], cloud[i + 1], cloud[i + 2]), x = Math.round(q[0]), y = Math.round(q[1]);
      if (x < 0 || y < 0 || x >= W - 1 || y >= H - 1 || q[2] < depth[y * W + x] - bias) continue;
      px[y * W + x] = px[y * W + x + 1] = 0xff8a7a1f;
    }
    ctx.putImageData(frame, 0, 0);
    ctx.lineCap = ctx.lineJoin = 'round';
    const seen = (x, y, z) => { x = Math.round(x); y = Math.round(y); return x < 0 || y < 0 || x >= W || y >= H || z >= depth[y * W + x] - bias; };
    function line(points, width, colour, hidden, dash) {
      ctx.lineWidth = width * ratio;
      ctx.setLineDash(dash ? dash.map(d => d * ratio) : []);
      let before = null, style = null;
      const flush = () => { if (style) ctx.stroke(); style = null; };
      for (let i = 0; i < points.length; i += 3) {
        const q = project(points[i], points[i + 1], points[i + 2]);
        if (before) {
          const ok = seen((q[0] + before[0]) / 2, (q[1] + before[1]) / 2, (q[2] + before[2]) / 2);
          const alpha = ok ? 1 : hidden, col = typeof colour === 'function' ? colour(i / 3) : colour, key = alpha + col;
          if (alpha > 0) {
            if (style !== key) { flush(); ctx.beginPath(); ctx.moveTo(before[0], before[1]); ctx.globalAlpha = alpha; ctx.strokeStyle = col; style = key; }
            ctx.lineTo(q[0], q[1]);
          } else flush();
        }
        before = q;
      }
      flush();
      ctx.globalAlpha = 1; ctx.setLineDash([]);
    }
    if (state.show.outline) for (const l of data.lines || []) line(l, 0.8, '#7c8896', 0);
    if (state.show.nominal) for (const e of data.wanted || []) {
      if (e.blamed) line(e.p, 8, '#ffffff', 0.3);
      line(e.p, e.blamed ? 4.5 : 2.2, e.blamed ? '#b02a20' : '#2a6fb0', e.blamed ? 0.35 : 0.12);
    }
    data.edges.forEach((e, k) => {
      const on = state.edge === k;
      if (state.show.nominal) line(e.nominal, 1.2, '#3b4652', 0.12, [4, 3]);
      if (state.show.adapted) {
        const p = new Array(e.adapted.length);
        for (let i = 0; i < p.length; ++i) p[i] = e.nominal[i] + state.exaggeration * (e.adapted[i] - e.nominal[i]);
        if (on) line(p, 7, '#ffffff', 0.25);
        line(p, on ? 4.5 : 3, i => e.status && e.status[i] === 2 ? '#a0a8b1' : scale(e.deviation[i]), 0.16);
      }
    });
    if (state.show.path) for (const p of data.passes || []) line(p.tip, 1.3, '#7a3fa8', 0.1);
    if (state.show.approach) for (const m of data.moves || []) line(m.p, 1.1, m.kind === 'transfer' ? '#8b97a4' : '#2b8a76', 0.15, m.kind === 'transfer' ? [6, 4] : null);
    if (state.mark) {
      const q = project(state.mark[0], state.mark[1], state.mark[2]);
      ctx.beginPath(); ctx.arc(q[0], q[1], 6 * ratio, 0, 7); ctx.lineWidth = 2 * ratio; ctx.strokeStyle = '#fff'; ctx.stroke();
      ctx.beginPath(); ctx.arc(q[0], q[1], 5 * ratio, 0, 7); ctx.strokeStyle = '#111'; ctx.stroke();
    }
    // the part's axes
    const ax = 46 * ratio, ay = 46 * ratio, len = 26 * ratio;
    ['x', 'y', 'z'].forEach((name, i) => {
      const x = ax + len * R[i], y = ay - len * U[i];
      ctx.strokeStyle = ctx.fillStyle = ['#b3362c', '#2d7d46', '#2a5fa5'][i];
      ctx.lineWidth = 1.6 * ratio; ctx.beginPath(); ctx.moveTo(ax, ay); ctx.lineTo(x, y); ctx.stroke();
      ctx.font = 11 * ratio + 'px system-ui, sans-serif'; ctx.textAlign = 'center'; ctx.textBaseline = 'middle';
      ctx.fillText(name, ax + 1.35 * len * R[i], ay - 1.35 * len * U[i]);
    });
    // a length to compare with
    const raw = 110 * ratio / s, p10 = Math.pow(10, Math.floor(Math.log10(raw))), nice = p10 * (raw / p10 >= 5 ? 5 : raw / p10 >= 2 ? 2 : 1);
    const bw = nice * s, bx = W - 16 * ratio - bw, by = 20 * ratio;
    ctx.strokeStyle = ctx.fillStyle = '#5a6572'; ctx.lineWidth = 1.4 * ratio;
    ctx.beginPath(); ctx.moveTo(bx, by - 3 * ratio); ctx.lineTo(bx, by + 3 * ratio); ctx.moveTo(bx, by); ctx.lineTo(bx + bw, by); ctx.moveTo(bx + bw, by - 3 * ratio); ctx.lineTo(bx + bw, by + 3 * ratio); ctx.stroke();
    ctx.textAlign = 'right'; ctx.textBaseline = 'top'; ctx.fillText(nice + ' mm', bx + bw, by + 6 * ratio);
  }
  let asked = false, idle = 0;
  function redraw(fine) {
    clearTimeout(idle);
    if (fine) { draw(true); return; }
    if (!asked) { asked = true; requestAnimationFrame(() => { asked = false; draw(false); }); }
    idle = setTimeout(() => draw(true), 180);
  }
  const fingers = new Map();
  let pinch = 0;
  canvas.addEventListener('pointerdown', e => { canvas.setPointerCapture(e.pointerId); fingers.set(e.pointerId, [e.clientX, e.clientY]); });
  canvas.addEventListener('pointerup', e => { fingers.delete(e.pointerId); pinch = 0; });
  canvas.addEventListener('pointercancel', e => { fingers.delete(e.pointerId); pinch = 0; });
  canvas.addEventListener('pointermove', e => {
    const old = fingers.get(e.pointerId);
    if (!old) return;
    const dx = e.clientX - old[0], dy = e.clientY - old[1];
    fingers.set(e.pointerId, [e.clientX, e.clientY]);
    if (fingers.size === 2) {
      const [a, b] = [...fingers.values()], d = Math.hypot(a[0] - b[0], a[1] - b[1]);
      if (pinch) state.zoom = Math.min(200, Math.max(0.2, state.zoom * d / pinch));
      pinch = d; state.pan[0] += dx / 2; state.pan[1] += dy / 2;
    } else if (e.shiftKey || e.buttons & 6) { state.pan[0] += dx; state.pan[1] += dy; }
    else { state.yaw += dx * 0.008; state.pitch = Math.max(-1.5708, Math.min(1.5708, state.pitch + dy * 0.008)); }
    redraw(false);
  });
  canvas.addEventListener('contextmenu', e => e.preventDefault());
  canvas.addEventListener('wheel', e => {
    e.preventDefault();
    const f = Math.exp(-e.deltaY * 0.0012), r = canvas.getBoundingClientRect(), x = e.clientX - r.left - r.width / 2, y = e.clientY - r.top - r.height / 2;
    const z = Math.min(200, Math.max(0.2, state.zoom * f)), g = z / state.zoom;
    state.pan = [x - (x - state.pan[0]) * g, y - (y - state.pan[1]) * g];
    state.zoom = z;
    redraw(false);
  }, {passive: false});
  canvas.addEventListener('keydown', e => {
    const step = {ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1]}[e.key];
    if (step) { state.yaw += step[0]; state.pitch = Math.max(-1.5708, Math.min(1.5708, state.pitch + step[1])); }
    else if (e.key === '+' || e.key === '=') state.zoom = Math.min(200, state.zoom * 1.2);
    else if (e.key === '-') state.zoom = Math.max(0.2, state.zoom / 1.2);
    else return;
    e.preventDefault(); redraw(false);
  });
  canvas.addEventListener('dblclick', () => api.look('home'));
  const api = {
    state, redraw, read,
    look(name) {
      const v = {home: [-0.65, 0.62], top: [0, 1.5708], front: [0, 0], side: [1.5708, 0], below: [-0.65, -0.62]}[name];
      state.yaw = v[0]; state.pitch = v[1]; state.zoom = 1; state.pan = [0, 0]; state.about = centre.slice();
      refit(); redraw(true);
    },
    lookAt(points) {
      let a = [1e30, 1e30, 1e30], b = [-1e30, -1e30, -1e30];
      for (let i = 0; i < points.length; ++i) { a[i % 3] = Math.min(a[i % 3], points[i]); b[i % 3] = Math.max(b[i % 3], points[i]); }
      state.about = [0, 1, 2].map(i => (a[i] + b[i]) / 2); state.pan = [0, 0];
      state.zoom = Math.max(1, Math.min(40, 0.55 * diagonal / Math.max(1e-6, Math.hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]))));
      redraw(true);
    },
    select(k) { state.edge = k; redraw(true); },
    mark(p, text) { state.mark = p; read.textContent = text || ''; redraw(false); }
  };
  new ResizeObserver(() => redraw(true)).observe(canvas);
  window.addEventListener('beforeprint', () => redraw(true));
  refit();
  redraw(true);
  return api;
}
