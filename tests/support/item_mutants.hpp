// SPDX-License-Identifier: GPL-3.0-or-later
// The programs of whole items, every single-token change of them, and who objects: the reader, the rules, the comparison with the plan,
// the replay of the item. Header only: tests and the study build it with their own item.
#pragma once

#include <map>

#include "planner/verify/verify.hpp"
#include "postprocessors/rounding.hpp"
#include "tests/support/post_programs.hpp"
#include "tests/support/text_mutants.hpp"
#include "tests/unit/verify/item.hpp"

namespace asbuilt::support {

/// An item with a part turned and moved, other burrs, another place in the cell for each number.
inline testing::Item numbered_item(int number) {
  return testing::box_item([number](testing::World& w) {
    Random r = Random::stream(number, "item");
    w.location.T_base_part.p_mm += Vec3(r.uniform(-60, 60), r.uniform(-120, 120), 0);
    w.location.T_base_part.q = quat_from_zyx(r.uniform(-0.5, 0.5), r.uniform(-0.01, 0.01), r.uniform(-0.01, 0.01));
    w.job.fixture.T_base_fixture.p_mm += Vec3(w.location.T_base_part.p_mm.x() - 1200, w.location.T_base_part.p_mm.y(), 0);
    w.job.fixture.mesh_fixture = {};  // the table below stays
  });
}

inline PostContext item_context(const testing::Item& item) {
  PostContext c = post_context();
  c.cell.robot = item.world.job.cell.robot;
  c.cell.tools = item.world.job.cell.tools;
  for (ToolSpec& t : c.cell.tools) t.spindle.output = 5, t.spindle.analog = 1;
  c.cell.obstacles = item.world.job.cell.obstacles;
  return c;
}

struct MutantCount {
  int programs = 0, mutants = 0, by_reader = 0, by_rules = 0, by_comparison = 0, by_replay_alone = 0, by_replay_too = 0, replayed = 0;
  std::map<std::string, int> harmless;         // survivors by class
  std::vector<std::string> unexplained;
  int survivors() const { return mutants - by_reader - by_rules - by_comparison - by_replay_alone; }
};

/// One change for every token (`every` = 1) or for every n-th. The replay is asked about every mutant that reads and that no rule names.
inline void count_mutants(MutantCount& count, const testing::Item& item, const Post& post, int seed, std::size_t every, int replays_at_most) {
  const PostContext context = item_context(item);
  testing::World world = item.world;
  world.job.cell.tools = context.cell.tools;
  const auto text = post.write(item.program, context);
  if (!text) throw std::runtime_error(text_of(text.error()));
  double joint_step = 0;
  for (double step : post.joint_step_rad(context)) joint_step = std::max(joint_step, step);
  Random random = Random::stream(seed, "text mutants");
  ++count.programs;
  std::size_t n = random.below(every);
  for (const TextToken& t : tokens_of(*text)) {
    if (n++ % every != 0) continue;
    const std::string token = text->files[t.file].bytes.substr(t.begin, t.end - t.begin);
    const auto changes = changes_of(token, random);
    const std::string& change = changes[random.below(changes.size())];
    ProgramText mutant = *text;
    mutant.files[t.file].bytes.replace(t.begin, t.end - t.begin, change);
    ++count.mutants;
    const auto back = post.read(mutant, context);
    if (!back) {
      ++count.by_reader;
      continue;
    }
    bool is_linted = false;
    for (const Check& c : post.lint(mutant, context)) is_linted |= !c.is_passed;
    if (is_linted) {
      ++count.by_rules;
      continue;
    }
    const bool is_same = compare_programs(item.program, *back, post.position_step_mm, post.angle_step_rad, post.speed_step_mm_s, joint_step, keeps_rounding(post, context) ? post.blend_step_mm : 0).is_ok();
    bool is_replayed_ok = true;
    if (count.replayed < replays_at_most || is_same) {
      ++count.replayed;
      is_replayed_ok = verify_item(world.job, world.location, world.features, world.burrs, item.path, *back).is_ok();
    }
    if (!is_same) {
      ++count.by_comparison;
      count.by_replay_too += !is_replayed_ok;
      continue;
    }
    if (!is_replayed_ok) {
      ++count.by_replay_alone;
      continue;
    }
    const std::string before = line_around(text->files[t.file].bytes, t.begin), why = harmless(post.language, before, token, change);
    if (!why.empty()) ++count.harmless[std::string(name_of(post.language)) + ": " + why];
    else count.unexplained.push_back(std::string(name_of(post.language)) + ": " + before + "  ->  " + line_around(mutant.files[t.file].bytes, t.begin));
  }
}

inline void print(const MutantCount& c) {
  std::printf("%d programs, %d mutants: reader %d, rules %d, comparison %d, replay alone %d; survive %d, caught %.3f %%\n", c.programs, c.mutants, c.by_reader,
              c.by_rules, c.by_comparison, c.by_replay_alone, c.survivors(), 100.0 * (c.mutants - c.survivors()) / std::max(1, c.mutants));
  std::printf("of %d replayed as items the replay by itself refuses %d\n", c.replayed, c.by_replay_too + c.by_replay_alone);
  for (const auto& [why, n] : c.harmless) std::printf("  %5d %s\n", n, why.c_str());
  for (const std::string& s : c.unexplained) std::printf("  not explained: %s\n", s.c_str());
}

}  // namespace asbuilt::support
