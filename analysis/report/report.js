// Draws the report from the JSON in #data; written by `lanewise report`. Colours: Okabe and Ito, told apart by
// colour-blind readers too.
'use strict';
(() => {
  const data = JSON.parse(document.getElementById('data').textContent);
  const page = document.getElementById('page');
  const palette = ['#0072B2', '#D55E00', '#009E73', '#CC79A7', '#E69F00', '#56B4E9', '#666666'];
  const colour = {};
  data.labels.forEach((label, i) => { colour[label] = palette[i % palette.length]; });

  const element = (tag, attributes = {}, ...children) => {
    const node = document.createElement(tag);
    for (const [key, value] of Object.entries(attributes)) node[key] = value;
    node.append(...children);
    return node;
  };
  const format = (value, digits = 4) => value == null ? '-' : value.toLocaleString('en', {maximumSignificantDigits: digits});
  const escape = (text) => String(text).replace(/[&<>"]/g, (c) => ({'&': '&amp;', '<': '&lt;', '>': '&gt;', '"': '&quot;'}[c]));

  // Beside the toolbox, with arrows if there are too many.
  const legend = {top: 4, left: 60, width: page.clientWidth - 260, type: 'scroll'};
  const charts = [];
  /** A section with selectors and a chart; `draw(values)` gives the chart's options for the selectors' values. */
  function chart(id, title, hint, selectors, draw, tall = false) {
    const box = element('div', {className: tall ? 'chart tall' : 'chart', id});
    const controls = element('div');
    const selects = selectors.map(([name, options]) => {
      const select = element('select', {}, ...options.map(([value, text]) => element('option', {value}, text)));
      controls.append(element('label', {}, name + ' ', select));
      return select;
    });
    page.append(element('section', {}, element('h2', {}, title), element('p', {className: 'hint'}, hint), controls, box));
    let instance = null;
    const update = () => {
      const options = draw(selects.map((select) => select.value));
      if (!options) {
        if (instance) instance.dispose();
        instance = null;
        box.className = 'none';
        box.textContent = 'Not recorded in these runs.';
        return;
      }
      box.className = tall ? 'chart tall' : 'chart';
      if (!instance) { box.textContent = ''; instance = echarts.init(box); charts.push(instance); }
      instance.setOption({animation: false, textStyle: {fontFamily: 'system-ui, sans-serif'},
        toolbox: {right: 8, feature: {dataZoom: {}, restore: {}, saveAsImage: {name: id}}}, ...options}, true);
    };
    selects.forEach((select) => select.addEventListener('change', update));
    update();
  }
  window.addEventListener('resize', () => charts.forEach((c) => { if (!c.isDisposed()) c.resize(); }));

  const axis = (name, more = {}) => ({type: 'value', name, nameLocation: 'middle', nameGap: 32, scale: true,
    nameTextStyle: {fontWeight: 600}, ...more});
  const mean = (v) => v.reduce((a, b) => a + b, 0) / v.length;
  const grid = {left: 80, right: 40, top: 50, bottom: 60};
  const scenarios = data.comparison.scenarios.map((s, i) => [i, s.scenario]);
  const metrics = data.metrics.map((m) => [m.name, m.label]);

  // Head and verdicts.
  page.append(element('h1', {}, 'Lanewise report'),
    element('p', {className: 'hint'}, `${data.runs.length} runs of ${data.labels.join(', ')}; made by Lanewise ${data.version}, ${data.created}. Everything is in this file; it needs no network.`));
  for (const s of data.comparison.scenarios) {
    const section = element('section', {}, element('h2', {}, `${s.scenario}: policies against ${s.baseline || 'nobody'}`));
    if (s.partial) section.append(element('p', {className: 'partial'}, 'Partial: some of what was recorded is not in the comparison; see the notes.'));
    for (const c of s.comparisons) {
      const rows = c.metrics.map((m) => {
        const d = m.difference, info = data.metrics.find((x) => x.name === m.metric);
        const settled = m.verdict === 'lower' || m.verdict === 'higher';
        const good = settled && info.better !== 'neither' && m.verdict === info.better;
        const verdict = settled ? (info.better === 'neither' ? m.verdict : good ? 'better' : 'worse')
          : m.verdict === 'open' ? `open: ${m.seeds_needed == null ? 'above 1e6' : m.seeds_needed} seeds` : m.verdict;
        return element('tr', {}, element('td', {}, m.label), ...[format(m.baseline_mean), format(m.policy_mean), format(d.mean),
          d.interval ? `[${format(d.interval[0], 3)}, ${format(d.interval[1], 3)}]` : '-',
          m.p_holm == null ? '-' : m.p_holm < 0.001 ? '<0.001' : m.p_holm.toFixed(3)].map((t) => element('td', {className: 'number'}, t)),
          element('td', {className: settled && info.better !== 'neither' ? (good ? 'better' : 'worse') : ''}, verdict));
      });
      const head = ['metric', s.baseline, c.policy, 'difference', '95 % interval', 'p (Holm)', 'verdict'];
      section.append(element('p', {}, `${c.policy}: ${c.pairs} pairs of equal seed and demand`),
        element('div', {className: 'scroll'}, element('table', {}, element('tr', {}, ...head.map((t, i) => element('th', {className: i > 0 && i < 6 ? 'number' : ''}, t))), ...rows)));
    }
    if (s.notes.length) section.append(element('p', {className: 'hint'}, 'Notes'), element('ul', {}, ...s.notes.map((n) => element('li', {className: 'hint'}, n))));
    page.append(section);
  }

  // Who drove in fact.
  const drivers = [...new Set(data.runs.flatMap((r) => r.shares.map(([policy]) => policy)))].sort();
  chart('shares', 'Who drove', 'Realised shares of the policies among the vehicles that entered; mean over the runs of a label.', [['scenario', scenarios]], ([si]) => {
    const used = data.runs.filter((r) => r.scenario === data.comparison.scenarios[si].scenario && r.used);
    const labels = data.labels.filter((label) => used.some((r) => r.label === label));
    if (!labels.length) return null;
    const share = (label, policy) => mean(used.filter((r) => r.label === label).map((r) => 100 * (r.shares.find(([p]) => p === policy) || [policy, 0])[1]));
    return {grid: {...grid, left: 170}, legend, color: palette, xAxis: axis('share of vehicles [%]', {min: 0, max: 100}),
      yAxis: {type: 'category', data: labels, inverse: true, axisLabel: {width: 150, overflow: 'break', lineHeight: 14}},
      tooltip: {trigger: 'axis', axisPointer: {type: 'shadow'}, valueFormatter: (v) => `${format(v)} %`},
      series: drivers.map((policy) => ({name: policy, type: 'bar', stack: 'all', barMaxWidth: 34, encode: {x: 0, y: 1}, data: labels.map((label, i) => [share(label, policy), i])}))};
  });

  // Metric by policy: mean and interval, each run a point.
  chart('metric', 'Metric by policy', 'Bar: 95 % interval of the mean over runs; small points: runs.', [['scenario', scenarios], ['metric', metrics]], ([si, name]) => {
    const s = data.comparison.scenarios[si], info = data.metrics.find((m) => m.name === name);
    const labels = s.policies.map((p) => p.policy);
    const summaries = s.policies.map((p) => p.metrics[name]);
    const points = data.runs.filter((r) => r.scenario === s.scenario && labels.includes(r.label) && r.used && r.metrics[name] != null)
      .map((r) => ({value: [labels.indexOf(r.label), r.metrics[name]], run: r, itemStyle: {color: colour[r.label]}}));
    const whisker = (params, api) => {
      const low = api.coord([api.value(0), api.value(1)]), high = api.coord([api.value(0), api.value(2)]), w = 14;
      const line = (x1, y1, x2, y2) => ({type: 'line', shape: {x1, y1, x2, y2}, style: {stroke: '#1c2733', lineWidth: 2}});
      return {type: 'group', children: [line(low[0], low[1], high[0], high[1]), line(low[0] - w, low[1], low[0] + w, low[1]), line(low[0] - w, high[1], low[0] + w, high[1])]};
    };
    return {grid, xAxis: {type: 'category', data: labels, axisLabel: {interval: 0, width: (page.clientWidth - 160) / labels.length - 8, overflow: 'break', lineHeight: 14}}, yAxis: axis(info.label, {nameGap: 60}),
      tooltip: {trigger: 'item', formatter: (p) => p.data.run ? `run ${p.data.run.run_id}, seed ${p.data.run.seed}<br>${escape(p.data.run.label)}<br><b>${format(p.value[1])}</b>`
        : `${escape(labels[p.value[0]])}<br>mean <b>${format(summaries[p.value[0]].mean)}</b>` + (summaries[p.value[0]].interval ? `<br>95 %: ${summaries[p.value[0]].interval.map((v) => format(v)).join(' to ')}` : '')},
      series: [
        {type: 'scatter', symbolSize: 6, data: points, itemStyle: {opacity: 0.45}},
        {type: 'custom', renderItem: whisker, encode: {x: 0, y: [1, 2]}, data: summaries.map((m, i) => m.interval ? [i, ...m.interval] : null).filter(Boolean)},
        {type: 'scatter', symbolSize: 14, symbol: 'diamond', data: summaries.map((m, i) => m.mean == null ? null : {value: [i, m.mean], itemStyle: {color: colour[labels[i]]}}).filter(Boolean)}]};
  });

  // Time-space diagram of one edge.
  if (data.time_space.length) {
    const speeds = Math.max(1, ...data.time_space.flatMap((t) => t.lines.flatMap((l) => l.points.map((p) => p[2]))));
    chart('time-space', 'Time-space diagram', 'Vehicles on the busiest edge in its busiest interval; a line is a vehicle, its colour the speed.',
      [['run', data.time_space.map((t, i) => [i, `${t.label}, run ${t.run_id}: edge ${t.edge}`])]], ([i]) => {
        const t = data.time_space[i];
        if (!t.lines.length) return null;
        return {grid: {...grid, right: 110}, xAxis: axis('time [s]'), yAxis: axis('position on the edge [m]', {nameGap: 50}),
          visualMap: {type: 'continuous', seriesIndex: 0, dimension: 2, min: 0, max: speeds, text: ['m/s', ''], right: 0, top: 'middle', calculable: true, inRange: {color: ['#b3261e', '#e6a817', '#1b7837']}},
          dataZoom: [{type: 'inside'}, {type: 'inside', yAxisIndex: 0}],
          tooltip: {trigger: 'item', formatter: (p) => `${escape(p.data.id)}<br>t ${format(p.value[0])} s, ${format(p.value[1])} m<br><b>${format(p.value[2], 3)} m/s</b>`},
          series: [{type: 'scatter', symbolSize: 4, data: t.lines.flatMap((l) => l.points.map((p) => ({value: p, id: l.id})))},
            ...t.lines.map((l) => ({type: 'line', silent: true, symbol: 'none', lineStyle: {width: 1, color: '#9aa7b4'}, z: 1, data: l.points.map((p) => [p[0], p[1]])}))]};
      });
  } else chart('time-space', 'Time-space diagram', '', [], () => null);

  // Flow and density, per lane.
  chart('flow-density', 'Flow and density', 'One point an edge and interval, by Edie’s definitions, per lane; junctions left out. A sample where there are very many.', [['scenario', scenarios]], ([si]) => {
    const sets = data.flow_density.filter((f) => f.scenario === data.comparison.scenarios[si].scenario && f.points.length);
    if (!sets.length) return null;
    return {grid, legend, xAxis: axis('density [veh/km and lane]', {min: 0}), yAxis: axis('flow [veh/h and lane]', {nameGap: 55, min: 0}),
      dataZoom: [{type: 'inside'}, {type: 'inside', yAxisIndex: 0}],
      tooltip: {trigger: 'item', formatter: (p) => `${escape(p.seriesName)}<br>edge ${escape(p.value[2])}<br>${format(p.value[0], 3)} veh/km, <b>${format(p.value[1], 3)} veh/h</b>`},
      series: sets.map((f) => ({name: f.label, type: 'scatter', large: false, symbolSize: 5, itemStyle: {color: colour[f.label], opacity: 0.5}, data: f.points}))};
  });

  // Distributions of TTC and PET.
  chart('cdf', 'How close: distribution of TTC and PET', 'Share of encounters with a value up to x; all runs of a policy together. Count and thresholds matter as much as the shape.',
    [['scenario', scenarios], ['measure', [['min_ttc_s', 'smallest TTC'], ['pet_s', 'PET']]]], ([si, measure]) => {
      const sets = data.cdf.filter((c) => c.scenario === data.comparison.scenarios[si].scenario && c.measure === measure && c.points.length);
      if (!sets.length) return null;
      return {grid, legend, xAxis: axis(measure === 'pet_s' ? 'PET [s]' : 'smallest TTC [s]', {min: 0}), yAxis: axis('share of encounters', {min: 0, max: 1, nameGap: 45}),
        tooltip: {trigger: 'axis', axisPointer: {type: 'cross'}, valueFormatter: (v) => format(v, 3)},
        series: sets.map((c) => ({name: `${c.label} (${c.count.toLocaleString('en')} encounters)`, type: 'line', step: 'end', symbol: 'none', color: colour[c.label], data: c.points}))};
    });

  // How smooth.
  const comfort = {jerk_mps3: 'jerk, either way [m/s^3]', lateral_accel_mps2: 'lateral acceleration, either side [m/s^2]', accel_mps2: 'deceleration [m/s^2]'};
  chart('comfort', 'How smooth: jerk, lateral acceleration, braking', 'Share of all driving time spent at x or more; planned stops left out.',
    [['scenario', scenarios], ['measure', Object.entries(comfort)]], ([si, measure]) => {
      const sets = data.comfort.filter((c) => c.scenario === data.comparison.scenarios[si].scenario && c.shares[measure]);
      if (!sets.length) return null;
      const both = measure !== 'accel_mps2';
      // A bin [lower, upper, share] without a bound is open.
      const beyond = (bins, x) => bins.reduce((sum, [lower, upper, share]) => sum + ((both && lower != null && lower >= x) || (upper != null && -upper >= x) ? share : 0), 0);
      const curve = (bins) => [...new Set(bins.flatMap(([lower, upper]) => [lower, upper]).filter((x) => x != null).map(Math.abs))].sort((a, b) => a - b)
        .map((x) => [x, Math.min(1, beyond(bins, x))]).filter(([, share]) => share > 0);
      return {grid, legend, xAxis: axis(comfort[measure], {min: 0}), yAxis: {...axis('share of driving time', {nameGap: 55}), type: 'log', max: 1},
        tooltip: {trigger: 'axis', axisPointer: {type: 'cross'}, valueFormatter: (v) => format(v, 3)},
        series: sets.map((c) => ({name: c.label, type: 'line', symbol: 'none', color: colour[c.label], data: curve(c.shares[measure])}))};
    });

  // Conflict map.
  if (data.maps.length) {
    const types = [...new Set(data.maps.flatMap((m) => m.points.map((p) => p[2])))].sort();
    chart('map', 'Where: conflicts on the network', 'Encounters of one run by type; large ones are serious (severity 2) or contacts (3). Scroll to zoom, drag to move.',
      [['run', data.maps.map((m, i) => [i, `${m.scenario}, ${m.label}, run ${m.run_id}`])]], ([i]) => {
        const m = data.maps[i], net = data.networks[m.scenario] || [];
        const xs = m.points.map((p) => p[0]).concat(net.flatMap((l) => l.map((p) => p[0]))), ys = m.points.map((p) => p[1]).concat(net.flatMap((l) => l.map((p) => p[1])));
        if (!xs.length) return null;
        const bound = (v) => v.reduce(([a, b], x) => [Math.min(a, x), Math.max(b, x)], [Infinity, -Infinity]);
        const [x0, x1] = bound(xs), [y0, y1] = bound(ys);
        // Equal scales: the box is 1100 by 520 pixels.
        const scale = Math.max((x1 - x0) / (page.clientWidth - 180), (y1 - y0) / 510) * 1.04 || 1;
        const range = (a, b, pixels) => ({min: (a + b - pixels * scale) / 2, max: (a + b + pixels * scale) / 2});
        const plain = {axisLabel: {formatter: (v) => Math.round(v), showMinLabel: false, showMaxLabel: false}, axisLine: {onZero: false}, splitLine: {show: false}};
        return {grid: {left: 70, right: 40, top: 50, bottom: 50}, legend,
          xAxis: axis('x [m]', {...range(x0, x1, page.clientWidth - 180), ...plain}), yAxis: axis('y [m]', {...range(y0, y1, 520), ...plain, nameGap: 50}),
          dataZoom: [{type: 'inside', filterMode: 'none'}, {type: 'inside', yAxisIndex: 0, filterMode: 'none'}],
          tooltip: {trigger: 'item', formatter: (p) => p.value[2] ? `${escape(p.value[2])}, severity ${p.value[3]}<br>${escape(p.value[6])} and ${escape(p.value[7])}<br>TTC ${format(p.value[4], 3)} s, PET ${format(p.value[5], 3)} s` : ''},
          series: [{type: 'lines', coordinateSystem: 'cartesian2d', polyline: true, silent: true, lineStyle: {color: '#b8c2cc', width: 1.5, opacity: 1}, data: net.map((coords) => ({coords}))},
            ...types.map((type, k) => ({name: type, type: 'scatter', itemStyle: {color: palette[k % palette.length], opacity: 0.7},
              symbolSize: (v) => v[3] >= 3 ? 13 : v[3] === 2 ? 9 : 5, data: m.points.filter((p) => p[2] === type)}))]};
      }, true);
  } else chart('map', 'Where: conflicts on the network', '', [], () => null);

  /** A metric over x(run): a small point for each run, a line through the means of the labels of one kind; those of kind '' are on every line. */
  function against(runs, info, xName, x, kind) {
    const groups = new Map();
    for (const r of runs) {
      if (!groups.has(r.label)) groups.set(r.label, {kind: kind(r), runs: []});
      groups.get(r.label).runs.push(r);
    }
    const kinds = [...new Set([...groups.values()].map((g) => g.kind))].filter((k) => k !== '');
    const lines = (kinds.length ? kinds : ['']).map((name) => ({name: name || 'no agents', type: 'line', symbolSize: 9,
      data: [...groups.values()].filter((g) => g.kind === name || g.kind === '').map((g) => [mean(g.runs.map(x)), mean(g.runs.map((r) => r.metrics[info.name]))]).sort((a, b) => a[0] - b[0])}));
    return {grid, legend, color: palette.slice(1), xAxis: axis(`${xName} [%]`, {min: 0, max: 100}), yAxis: axis(info.label, {nameGap: 60, scale: true}),
      tooltip: {trigger: 'item', formatter: (p) => (p.data.run ? `run ${p.data.run.run_id}, seed ${p.data.run.seed}<br>${escape(p.data.run.label)}` : escape(p.seriesName)) + `<br>${format(p.value[0], 3)} % ${p.data.run ? '' : 'mean '}<br><b>${format(p.value[1])}</b>`},
      series: [{type: 'scatter', symbolSize: 6, itemStyle: {color: '#5b6b7b', opacity: 0.5}, data: runs.map((r) => ({value: [x(r), r.metrics[info.name]], run: r}))}, ...lines]};
  }

  // Metric against penetration.
  chart('penetration', 'Metric against penetration', 'Share of vehicles under an agent policy as realised, not as asked for. Small: a run; line: means of the runs of one label, the native ones included.', [['scenario', scenarios], ['metric', metrics]], ([si, name]) => {
    const s = data.comparison.scenarios[si], info = data.metrics.find((m) => m.name === name);
    const runs = data.runs.filter((r) => r.scenario === s.scenario && r.used && r.metrics[name] != null);
    if (!runs.length) return null;
    // Lines are told apart by who drives and by parameters.
    return against(runs, info, 'share of agents', (r) => 100 * r.agent_share,
      (r) => r.shares.filter(([p]) => p !== 'sumo').map(([p]) => p).sort().join('+') + (r.label.match(/ \[.*/) || [''])[0]);
  });

  // What went over the radio, if anything did.
  const radio = data.radio.filter((r) => r.points.length);
  if (radio.length) {
    const measures = [['delivered', 'messages delivered, of those at receivers in range'], ['age', 'age of information [s]'], ['busy', 'channel busy ratio'], ['sent', 'messages a second and station']];
    chart('radio', 'What went over the radio', 'By interval of time; means over the runs of a label. The channel busy ratio is known where the channel’s load is modelled.',
      [['scenario', scenarios], ['measure', measures]], ([si, measure]) => {
        const sets = radio.filter((r) => r.scenario === data.comparison.scenarios[si].scenario).map((r) => {
          const values = new Map();
          for (const p of r.points.filter((p) => p[measure] != null)) values.set(p.time, (values.get(p.time) || []).concat(p[measure]));
          return {label: r.label, data: [...values].map(([time, all]) => [time, mean(all)])};
        }).filter((s) => s.data.length);
        if (!sets.length) return null;
        return {grid, legend, xAxis: axis('time [s]'), yAxis: axis(measures.find(([m]) => m === measure)[1], {nameGap: 55, min: 0}),
          tooltip: {trigger: 'axis', axisPointer: {type: 'cross'}, valueFormatter: (v) => format(v, 3)},
          series: sets.map((s) => ({name: s.label, type: 'line', symbolSize: 5, color: colour[s.label], data: s.data}))};
      });
    chart('radio-share', 'Metric against the share with a radio, by channel', 'Share of vehicles that carry a radio, as asked for (v2x.share). Small: a run; line: means of the runs of one label. A higher share contains the vehicles of a lower one.',
      [['scenario', scenarios], ['metric', metrics]], ([si, name]) => {
        const s = data.comparison.scenarios[si];
        const runs = data.runs.filter((r) => r.scenario === s.scenario && r.used && r.radio_share != null && r.metrics[name] != null);
        if (!runs.length) return null;
        // The label less the share.
        return against(runs, data.metrics.find((m) => m.name === name), 'share with a radio', (r) => 100 * r.radio_share, (r) => r.label.replace(/v2x\.share=[^,\]]*(, )?/, '').replace(' []', ''));
      });
  }

  // Provenance.
  const columns = [['run', 'run_id'], ['file', 'file'], ['started (UTC)', 'started_at'], ['status', 'status'], ['scenario', 'scenario'], ['label', 'label'], ['seed', 'seed'], ['inserted', 'inserted'], ['arrived', 'arrived'],
    ['not inserted', 'not_inserted'], ['Lanewise', 'version'], ['SUMO', 'sumo_version'], ['machine', 'machine'], ['wall time [s]', 'wall_time'], ['state hash', 'state_hash'], ['traffic options', 'options']];
  page.append(element('section', {}, element('h2', {}, 'Provenance'), element('p', {className: 'hint'}, 'Every run in the files, also those left out above.'),
    element('div', {className: 'scroll'}, element('table', {className: 'wide'}, element('tr', {}, ...columns.map(([t]) => element('th', {}, t))),
      ...data.runs.map((r) => element('tr', {}, ...columns.map(([, k]) => element('td', {}, r[k] == null ? '-' : String(r[k]))))))),
    ...data.demands.flatMap((d) => [element('p', {className: 'hint'}, `Inputs of ${d.scenario}`), element('ul', {}, ...Object.entries(d.files).map(([f, h]) => element('li', {}, element('code', {}, `${f}  ${h}`))))])));
  document.documentElement.dataset.ready = String(charts.length);
})();
