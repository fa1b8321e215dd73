// SPDX-License-Identifier: GPL-3.0-or-later
// Every file of ../shared/data/step (or $ASBUILT_STEP_DIR) meshed at three chord tolerances and two angles: the distance of dense
// samples inside and along the sides of the triangles from the exact surfaces, the turn of the normals, closed meshes, and the Euler
// number against the one of the file's own faces, loops, edges and vertices. `study_step NAME..` takes only files with these in their name.
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "planner/io/step/step_reader.hpp"
#include "tests/bench/step/corpus_files.hpp"
#include "tests/unit/step/mesh_truth.hpp"

namespace fs = std::filesystem;
using namespace asbuilt;

int main(int argc, char** argv) {
  const std::vector<fs::path> files = bench::corpus_files();
  if (files.empty()) return 0;
  std::printf("%-42s %9s %8s %9s %9s %9s %9s %8s %8s %s\n", "file", "chord mm", "tri", "inside/c", "edges/c", "over", "turn/a", "turns>",
              "closed", "euler");
  std::size_t samples = 0, over = 0, turns = 0, turns_over = 0, singular = 0, short_singular = 0;
  int solids = 0, closed = 0, right = 0, files_over = 0;
  for (const fs::path& p : files) {
    const std::string name = p.filename().string();
    bool wanted = argc < 2;
    for (int k = 1; k < argc; ++k) wanted = wanted || name.find(argv[k]) != std::string::npos;
    if (!wanted) continue;
    std::ifstream in(p, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
    StepOptions o;
    o.want_mesh = false;
    const auto outline = read_step(bytes, name, o);
    if (!outline) continue;
    const std::vector<int> want = test::eulers_of_file(bytes);
    const bool is_sheet = want.empty() && outline->artefact.solids_count == 0;
    o.want_mesh = true;
    for (const auto& [part, angle] : {std::pair{1e-3, 0.5}, std::pair{3e-4, 0.25}, std::pair{1e-4, 0.1745}}) {
      o.chord_mm = std::max(1e-3, part * outline->artefact.box.diagonal_mm()), o.angle_rad = angle;
      const auto r = read_step(bytes, name, o);
      if (!r || (want.empty() && !is_sheet)) continue;  // refused, or triangles as given in the file
      const Brep& b = r->artefact;
      const test::ChordCheck c = test::check_chords(b, 4, o.chord_mm, angle);
      std::multiset<int> eulers;
      int these = 0;
      for (const auto& [body, k] : test::closedness(b)) {
        if (k.odd_sides == 0) ++these, eulers.insert(k.euler);
      }
      int match = 0;
      for (int e : want)
        if (const auto it = eulers.find(e); it != eulers.end()) eulers.erase(it), ++match;
      samples += c.samples, over += c.over, turns += c.turns, turns_over += c.turns_over;
      singular += c.singular, short_singular += c.short_singular;
      solids += b.solids_count, closed += std::min(these, b.solids_count), right += match, files_over += c.over > 0;
      std::printf("%-42s %9.4g %8zu %9.3f %9.3f %9zu %9.3f %8zu %4d/%-4d %d/%zu %s\n", name.c_str(), o.chord_mm, b.mesh.triangles.size(),
                  c.worst_mm / o.chord_mm, c.worst_edge_mm / o.chord_mm, c.over, c.worst_turn_rad / angle, c.turns_over, these,
                  b.solids_count, match, want.size(),
                  c.over         ? c.face.c_str()
                  : c.turns_over ? c.turn_face.c_str()
                                 : "");
      std::fflush(stdout);
    }
  }
  std::printf(
      "%zu samples, %zu over the chord in %d meshes; %zu sides, %zu over the angle (%zu measured a micrometre inside an end without a "
      "normal, %zu of them shorter than two); %d of %d solids closed, %d with the right Euler "
      "number\n",
      samples, over, files_over, turns, turns_over, singular, short_singular, closed, solids, right);
  return over == 0 && turns_over == 0 && closed == solids && right == solids ? 0 : 1;
}
