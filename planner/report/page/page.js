(function () {
  'use strict';
  const data = JSON.parse(document.getElementById('data').textContent);
  const stops = [[0, 38, 97, 156], [0.3, 74, 166, 166], [0.55, 240, 190, 80], [0.78, 217, 98, 36], [1, 150, 30, 30]];
  const most = data.deviation_max || 1;
  function scale(v) {
    const x = Math.max(0, Math.min(1, v / most));
    let k = 1;
    while (k < stops.length - 1 && stops[k][0] < x) ++k;
    const a = stops[k - 1], b = stops[k], f = (x - a[0]) / (b[0] - a[0]);
    return 'rgb(' + [1, 2, 3].map(i => Math.round(a[i] + f * (b[i] - a[i]))).join(',') + ')';
  }
  const viewBox = document.querySelector('.view');
  const view = viewBox ? makeView(viewBox, data, scale) : null;
  if (view) {
    const bar = viewBox.querySelector('.bar');
    if (bar) bar.style.background = 'linear-gradient(90deg,' + Array.from({length: 12}, (_, i) => scale(most * i / 11)).join(',') + ')';
    for (const input of document.querySelectorAll('[data-show]')) {
      input.checked = view.state.show[input.dataset.show];
      input.addEventListener('change', () => { view.state.show[input.dataset.show] = input.checked; view.redraw(true); });
    }
    for (const button of document.querySelectorAll('[data-look]')) button.addEventListener('click', () => button.dataset.look === 'edge'
      ? (view.state.edge >= 0 && view.lookAt(data.edges[view.state.edge].nominal)) : view.look(button.dataset.look));
    const slider = document.getElementById('exaggeration');
    if (slider) {
      const steps = [1, 2, 5, 10, 20, 50, 100, 200, 500];
      slider.max = steps.length - 1;
      slider.value = Math.max(0, steps.indexOf(view.state.exaggeration));
      const said = document.getElementById('exaggeration-said');
      const set = () => { view.state.exaggeration = steps[slider.value]; said.textContent = '×' + steps[slider.value]; view.redraw(true); };
      slider.addEventListener('input', set);
      set();
    }
  }
  const chartBox = document.querySelector('.charts');
  if (!chartBox || !data.edges.length) return;
  const f = (v, d) => v === null || v === undefined ? 'not seen' : v.toFixed(d);
  const charts = makeCharts(chartBox, (e, i) => {
    if (!view) return;
    if (i < 0) { view.mark(null, ''); return; }
    const k = view.state.exaggeration, p = [0, 1, 2].map(j => e.nominal[3 * i + j] + k * (e.adapted[3 * i + j] - e.nominal[3 * i + j]));
    view.mark(p, e.id + ' at ' + f(e.s[i], 1) + ' mm: deviation ' + f(e.deviation[i], 3) + ' mm' + (e.burr && e.burr.height ? ', burr ' + f(e.burr.height[i], 2) + (e.burr.height[i] === null ? '' : ' mm') : ''));
  });
  const rows = Array.from(document.querySelectorAll('[data-edge]'));
  const title = document.getElementById('edge-title');
  function select(k) {
    rows.forEach(r => r.classList.toggle('on', +r.dataset.edge === k));
    if (title) title.textContent = data.edges[k].id + ' of ' + data.edges[k].feature;
    charts.show(data.edges[k]);
    if (view) view.select(k);
  }
  for (const row of rows) {
    row.tabIndex = 0;
    row.addEventListener('click', () => select(+row.dataset.edge));
    row.addEventListener('keydown', e => { if (e.key === 'Enter' || e.key === ' ') { e.preventDefault(); select(+row.dataset.edge); } });
  }
  select(data.edge_first || 0);
})();
