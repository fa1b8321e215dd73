#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads emitted programs with a second, foreign set of parsers and compares with what was meant.

usage: second_readers.py READERS_DIR WORK_DIR    (READERS_DIR holds the package vc; WORK_DIR one folder a program)
Each program folder: cell.json, expected.json (list of motions), and krl/, inform/, beckhoff/ with the files.
Prints one line for each fault; exit 1 when there is any.
"""
import glob
import json
import os
import sys

import numpy as np

sys.path.insert(0, sys.argv[1])
from vc import programs as PR  # noqa: E402

work, faults, motions = sys.argv[2], [], 0
for folder in sorted(glob.glob(os.path.join(work, '*'))):
    cell = json.load(open(os.path.join(folder, 'cell.json')))
    expected = json.load(open(os.path.join(folder, 'expected.json')))
    for language in ('krl', 'inform', 'beckhoff'):
        files = sorted(glob.glob(os.path.join(folder, language, '*')))
        if not files:
            continue
        p = PR.READERS[language](files, PR.Context(cell))
        name = '%s/%s' % (os.path.basename(folder), language)
        faults += ['%s: issue %s' % (name, i) for i in p.issues if 'CWAIT' not in str(i)]  # a word those parsers do not know; it moves nothing
        got = p.moves
        if language == 'beckhoff':  # that reader cuts arcs into short lines: keep the last of a block
            got = [m for i, m in enumerate(got) if i + 1 == len(got) or got[i + 1]['line'] != m['line']]
        if language == 'inform':    # and lists the start of an arc that follows an arc twice
            got = [m for i, m in enumerate(got) if not (i and m['kind'] == 'lin' and got[i - 1]['pose'] is not None and m['pose'] is not None
                                                        and m['text'].startswith('MOVC') and np.abs(m['pose'] - got[i - 1]['pose']).max() < 1e-9)]
        if len(got) != len(expected):
            faults.append('%s: %d motions instead of %d' % (name, len(got), len(expected)))
            continue
        for i, (e, m) in enumerate(zip(expected, got)):
            motions += 1
            where = '%s motion %d (line %s)' % (name, i + 1, m['line'])
            if e['kind'] == 'joint':
                if m['joints'] is None or np.abs(np.array(e['joints']) - m['joints']).max() > 6e-4:
                    faults.append('%s: joints %s' % (where, m['joints']))
                continue
            if m['pose'] is None:
                faults.append('%s: no pose' % where)
                continue
            T = np.array(e['pose'])
            d, r = np.linalg.norm(T[:3, 3] - m['pose'][:3, 3]), np.abs(T[:3, :3] - m['pose'][:3, :3]).max()
            if d > 0.00088 or r > 3e-6:
                faults.append('%s: off by %.5f mm, %.2e' % (where, d, r))
            if abs(e['speed'] - m['speed']) > (0.0501 if language == 'inform' else 0.0006):
                faults.append('%s: speed %g instead of %g' % (where, m['speed'], e['speed']))
            if abs(e['spin'] - m['spin']) > 1.6:
                faults.append('%s: spindle %g instead of %g' % (where, m['spin'], e['spin']))
for f in faults[:30]:
    print(f)
print('%d motions compared, %d faults' % (motions, len(faults)))
sys.exit(1 if faults or not motions else 0)
