// Curves along one edge, one below the other over the same arc length, with a cross-hair through all of them.
function makeCharts(box, onPoint) {
  'use strict';
  const W = 1000, left = 52, right = 12, top = 6, low = 18;
  const NS = 'http://www.w3.org/2000/svg';
  const el = (name, set, parent) => {
    const e = document.createElementNS(NS, name);
    for (const k in set) e.setAttribute(k, set[k]);
    if (parent) parent.appendChild(e);
    return e;
  };
  const finite = v => v !== null && v !== undefined && isFinite(v);
  const text = (v, digits) => finite(v) ? (+v).toFixed(digits) : 'not seen';
  function ticks(a, b, count) {
    const raw = (b - a) / count, p = Math.pow(10, Math.floor(Math.log10(raw))), f = raw / p, step = p * (f > 5 ? 10 : f > 2 ? 5 : f > 1 ? 2 : 1), out = [];
    for (let v = Math.ceil(a / step - 1e-9) * step; v <= b + 1e-9 * step; v += step) out.push(Math.abs(v) < step * 1e-6 ? 0 : v);
    return {out, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9))};
  }
  let hairs = [], edge = null;
  function chart(e, spec) {
    const H = spec.height || 104, div = document.createElement('div');
    div.className = 'chart';
    const head = document.createElement('div');
    head.className = 'head';
    head.innerHTML = '<b></b><span></span>';
    head.firstChild.textContent = spec.title;
    const value = head.lastChild;
    value.textContent = spec.note || '';
    div.appendChild(head);
    const svg = el('svg', {viewBox: `0 0 ${W} ${H}`, role: 'img', 'aria-label': spec.title});
    div.appendChild(svg);
    let lo = spec.zero === false ? 1e30 : 0, hi = spec.least || 1e-6;
    for (const c of spec.curves) for (const v of c.y) if (finite(v)) { lo = Math.min(lo, v); hi = Math.max(hi, v); }
    for (const l of spec.levels || []) if (finite(l.y) && (l.force || l.y < 2.5 * hi)) hi = Math.max(hi, l.y);
    if (spec.zero === false) for (const l of spec.levels || []) if (finite(l.y)) lo = Math.min(lo, l.y);
    const pad = (hi - lo) * 0.06 || 1e-6;
    hi += pad; if (lo < 0 || spec.zero === false) lo -= pad;
    const s0 = e.s[0], s1 = e.s[e.s.length - 1] || 1, X = s => left + (W - left - right) * (s - s0) / ((s1 - s0) || 1), Y = v => H - low - (H - low - top) * (v - lo) / ((hi - lo) || 1);
    const t = ticks(lo, hi, 3);
    for (const v of t.out) {
      el('line', {x1: left, x2: W - right, y1: Y(v), y2: Y(v), stroke: v === 0 ? '#c3cbd4' : '#eaeef2'}, svg);
      el('text', {x: left - 6, y: Y(v) + 3.5, 'text-anchor': 'end'}, svg).textContent = v.toFixed(t.digits);
    }
    for (const v of ticks(s0, s1, 8).out) el('text', {x: X(v), y: H - 4, 'text-anchor': 'middle'}, svg).textContent = +v.toFixed(3);
    for (const gap of spec.gaps || []) el('rect', {x: X(gap[0]), y: top, width: Math.max(1.5, X(gap[1]) - X(gap[0])), height: H - low - top, fill: 'url(#unseen)'}, svg);
    for (const b of spec.bands || []) {
      let run = [];
      const flush = () => {
        if (run.length > 1) el('path', {d: 'M' + run.map(i => X(e.s[i]).toFixed(1) + ' ' + Y(Math.min(hi, b.hi[i])).toFixed(1)).join('L') + 'L' +
          run.slice().reverse().map(i => X(e.s[i]).toFixed(1) + ' ' + Y(Math.max(lo, b.lo[i])).toFixed(1)).join('L') + 'Z', fill: b.colour, stroke: 'none'}, svg);
        run = [];
      };
      e.s.forEach((s, i) => finite(b.lo[i]) && finite(b.hi[i]) ? run.push(i) : flush());
      flush();
    }
    for (const l of spec.levels || []) if (finite(l.y) && l.y <= hi) {
      el('line', {x1: left, x2: W - right, y1: Y(l.y), y2: Y(l.y), stroke: l.colour || '#b0584a', 'stroke-dasharray': '5 4', 'stroke-width': 1}, svg);
      el('text', {x: W - right - 2, y: Y(l.y) - 3, 'text-anchor': 'end'}, svg).textContent = l.name;
    }
    for (const c of spec.curves) {
      let d = '', pen = false;
      e.s.forEach((s, i) => { if (finite(c.y[i])) { d += (pen ? 'L' : 'M') + X(s).toFixed(1) + ' ' + Y(c.y[i]).toFixed(1); pen = true; } else pen = false; });
      el('path', {d, fill: 'none', stroke: c.colour, 'stroke-width': c.width || 1.6, 'stroke-linejoin': 'round', 'stroke-dasharray': c.dash || 'none'}, svg);
    }
    if (spec.strip) {
      let from = 0;
      for (let i = 1; i <= e.s.length; ++i) if (i === e.s.length || spec.strip[i] !== spec.strip[from]) {
        el('rect', {x: X(e.s[from]), y: H - low + 1.5, width: Math.max(1, X(e.s[Math.min(i, e.s.length - 1)]) - X(e.s[from])), height: 3, fill: ['#2d8a57', '#d19a2e', '#a0a8b1'][spec.strip[from]]}, svg);
        from = i;
      }
    }
    const hair = el('line', {x1: 0, x2: 0, y1: top, y2: H - low, stroke: '#1b2430', 'stroke-width': 1, visibility: 'hidden'}, svg);
    svg.addEventListener('pointermove', ev => {
      const r = svg.getBoundingClientRect(), s = s0 + (s1 - s0) * ((ev.clientX - r.left) / r.width * W - left) / (W - left - right);
      let i = 0;
      while (i + 1 < e.s.length && Math.abs(e.s[i + 1] - s) <= Math.abs(e.s[i] - s)) ++i;
      point(i);
    });
    svg.addEventListener('pointerleave', () => point(-1));
    hairs.push({set(i) {
      hair.setAttribute('visibility', i < 0 ? 'hidden' : 'visible');
      if (i < 0) { value.textContent = spec.note || ''; return; }
      const x = X(e.s[i]);
      hair.setAttribute('x1', x); hair.setAttribute('x2', x);
      value.textContent = spec.curves.map(c => (c.name ? c.name + ' ' : '') + text(c.y[i], spec.digits)).join('   ') + ' ' + spec.unit;
    }});
    box.appendChild(div);
  }
  function point(i) { for (const h of hairs) h.set(i); onPoint(edge, i); }
  return {
    show(e) {
      edge = e; hairs = []; box.textContent = '';
      const defs = el('svg', {width: 0, height: 0, style: 'position:absolute'});
      defs.innerHTML = '<defs><pattern id="unseen" width="7" height="7" patternUnits="userSpaceOnUse" patternTransform="rotate(45)"><rect width="7" height="7" fill="#f1f3f5"/><line x1="0" y1="0" x2="0" y2="7" stroke="#cfd6dd" stroke-width="2.4"/></pattern></defs>';
      box.appendChild(defs);
      const max = a => a.reduce((m, v) => finite(v) && v > m ? v : m, -1e30), any = a => a && a.some(finite);
      const range = (a, d, u) => any(a) ? 'up to ' + max(a).toFixed(d) + ' ' + u : '';
      const curves = [{y: e.deviation, colour: '#1b2430', name: 'whole', width: 1.8}], said = [];
      const most = max(e.deviation);
      const part = (y, name, colour, word) => { if (any(y)) { curves.push({y, colour, name, width: 1.2}); said.push(word + ': ' + name); } };
      // how far the part as a whole sits from its drawing's place can be a hundred times the rest: then it is said, not drawn
      if (any(e.rigid) && max(e.rigid) <= 4 * most) part(e.rigid, 'rigid', '#2a6fb0', 'blue');
      part(e.shape, 'feature', '#c2701c', 'orange');
      part(e.local, 'local', '#7a3fa8', 'violet');
      chart(e, {title: 'Deviation of the adapted edge from the drawing, mm', note: range(e.deviation, 3, 'mm') + (said.length ? ' (black: whole, ' + said.join(', ') + ')' : ''),
        unit: 'mm', digits: 3, curves, height: 124, strip: e.status});
      if (any(e.rigid) && max(e.rigid) > 4 * most) {
        const p = document.createElement('p');
        p.className = 'muted'; p.style.margin = '-4px 0 8px';
        p.textContent = 'With the part as a whole this edge sits ' + Math.min(...e.rigid.filter(finite)).toFixed(2) + ' to ' + max(e.rigid).toFixed(2) + ' mm from its place by the fixture\u2019s drawing (rigid).';
        box.appendChild(p);
      }
      if (e.burr && e.burr.height) {
        const h = e.burr.height, sd = e.burr.sd || [], gaps = [];
        for (let i = 0; i < h.length; ++i) if (!finite(h[i])) {
          let k = i;
          while (k + 1 < h.length && !finite(h[k + 1])) ++k;
          gaps.push([e.s[Math.max(0, i - 1)], e.s[Math.min(h.length - 1, k + 1)]]); i = k;
        }
        const curves = [{y: h, colour: '#b0392d', name: 'height'}];
        if (any(e.burr.width)) curves.push({y: e.burr.width, colour: '#8a8f98', name: 'root width', width: 1.1, dash: '4 3'});
        chart(e, {title: 'Burr height and root width, mm', note: any(h) ? range(h, 2, 'mm') + (gaps.length ? '; hatched: not seen' : '') : 'nothing was seen here', unit: 'mm', digits: 3, curves, gaps, height: 118,
          bands: any(sd) ? [{lo: h.map((v, i) => finite(v) ? Math.max(0, v - 2 * sd[i]) : null), hi: h.map((v, i) => finite(v) ? v + 2 * sd[i] : null), colour: '#b0392d22'}] : [],
          levels: [{y: e.burr.limit, name: 'detection limit', colour: '#8a8f98', force: true}, {y: e.limits && e.limits.burr, name: 'most the recipe may remove'}]});
      }
      if (any(e.feed)) chart(e, {title: 'Feed along the edge, mm/s', note: range(e.feed, 1, 'mm/s') + (e.passes ? ', ' + e.passes + (e.passes > 1 ? ' passes' : ' pass') : ''), unit: 'mm/s', digits: 1,
        curves: [{y: e.feed, colour: '#2d7d46'}], levels: e.limits ? [{y: e.limits.feed_min, name: 'least feed', colour: '#8a8f98'}, {y: e.limits.feed_max, name: 'greatest feed', colour: '#8a8f98'}] : []});
      if (any(e.sigma)) chart(e, {title: 'Uncertainty across the edge (1 sd), mm', note: range(e.sigma, 4, 'mm'), unit: 'mm', digits: 4, curves: [{y: e.sigma, colour: '#6b4fa0'}],
        levels: e.limits ? [{y: e.limits.tolerance, name: 'tolerance of the chamfer leg'}] : [], height: 92});
      if (any(e.clearance)) chart(e, {title: 'Clearance of the motion at this edge, mm', note: 'certified for the whole of each pass', unit: 'mm', digits: 2, curves: [{y: e.clearance, colour: '#1f7f8c'}], height: 84});
      if (any(e.probability)) chart(e, {title: 'Probability that both chamfer legs are in tolerance', unit: '', digits: 4, curves: [{y: e.probability, colour: '#23609f'}], least: 1, zero: false, height: 84,
        levels: e.limits ? [{y: e.limits.gate, name: 'least that may be emitted'}] : []});
    }
  };
}
