// SPDX-License-Identifier: GPL-3.0-or-later
// libFuzzer target of the STEP reader: any bytes give a part or a refusal with a place in it; never a crash, a hang or much memory.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "planner/io/step/step_reader.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  asbuilt::StepOptions options;
  options.angle_rad = 0.6;
  options.edge_step_mm = 50;
  options.want_mesh = false;
  const auto outline = asbuilt::read_step({reinterpret_cast<const char*>(data), size}, "fuzz.step", options);
  options.want_mesh = true;
  options.chord_mm = outline ? std::max(2.0, 2e-3 * outline->artefact.box.diagonal_mm()) : 2.0;  // parts of any size in little time
  const auto r = asbuilt::read_step({reinterpret_cast<const char*>(data), size}, "fuzz.step", options);
  if (!r) {
    for (const asbuilt::Refusal& e : r.error())
      if (e.code.empty() || e.where.find("fuzz.step:") != 0 || e.message.empty()) std::abort();
    return 0;
  }
  for (const auto& t : r->artefact.mesh.triangles)
    for (int v : t)
      if (v < 0 || v >= static_cast<int>(r->artefact.mesh.vertices.size())) std::abort();
  for (const auto& e : r->artefact.edges)
    if (e.p.size() != e.tangent.size() || e.p.size() != e.n_1.size() || e.p.size() != e.n_2.size() || e.p.size() != e.s_mm.size()) std::abort();
  return 0;
}
