// SPDX-License-Identifier: GPL-3.0-or-later
// Single-token changes of programs, and who objects: the reader, the rules, the comparison with the plan, the replay of the item. What nobody
// objects to is told by what it does: it moves the robot within the rounding that the plan allows, or nothing at all.
// Header only: tests and studies build it with their own programs.
#pragma once

#include <functional>
#include <map>
#include <stdexcept>

#include "planner/base/archive.hpp"
#include "planner/pipeline/posted.hpp"
#include "planner/verify/verify.hpp"
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

/// One program to be changed: its text, what it was planned to say, and the replay that judges it (none: every program passes).
struct MutantSubject {
  std::string name;
  const Post* post = nullptr;
  PostContext context;
  ProgramText text;
  Program planned;
  std::function<bool(const Program&)> is_replayed_ok;
};

inline MutantSubject subject_of(const testing::Item& item, const Post& post) {
  MutantSubject s{item.program.name, &post, item_context(item), {}, {}, {}};
  const auto shaped = shaped_for(post, item.program, s.context);
  if (!shaped) throw std::runtime_error(text_of(shaped.error()));
  s.planned = *shaped;
  const auto text = post.write(s.planned, s.context);
  if (!text) throw std::runtime_error(text_of(text.error()));
  s.text = *text;
  auto world = item.world;
  world.job.cell.tools = s.context.cell.tools;
  s.is_replayed_ok = [world, path = item.path](const Program& p) { return verify_item(world.job, world.location, world.features, world.burrs, path, p).is_ok(); };
  return s;
}

struct MutantCount {
  int programs = 0, tokens = 0, mutants = 0, by_reader = 0, by_rules = 0, by_comparison = 0, by_replay_alone = 0, by_replay_too = 0, replayed = 0;
  int within_rounding = 0;                     // survivors that move the robot, within half the last digit of the plan
  std::map<std::string, int> harmless;         // survivors by class
  std::map<std::string, std::string> example;
  std::vector<std::string> unexplained;
  int survivors() const { return mutants - by_reader - by_rules - by_comparison - by_replay_alone; }
};

struct MutantChoice {
  std::size_t every = 1;        // 1: every token, n: every n-th
  bool is_all_kinds = false;    // every kind of change of a token, or one drawn at random
  int replays_at_most = 0;      // of mutants that the comparison names anyway; every survivor is replayed
};

inline void count_mutants(MutantCount& count, const MutantSubject& subject, int seed, const MutantChoice& choice) {
  const Post& post = *subject.post;
  const auto original = post.read(subject.text, subject.context);
  if (!original) throw std::runtime_error(subject.name + ": " + text_of(original.error()));
  const std::string original_bytes = to_bytes(*original);
  const PrintedSteps steps = printed_steps(post, subject.context);
  // a mutant that reads as the original does to the rounding of the arithmetic (180 for -180 degrees) is replayed as the original was
  PrintedSteps unmoved{.position_mm = 1e-8, .angle_rad = 1e-9, .speed_mm_s = 1e-8, .joint_speed_ratio = 1e-9, .spindle_rpm = 1e-6, .time_s = 1e-9, .blend_mm = 1e-8};
  unmoved.joint_rad.fill(1e-9);
  for (const Check& c : compare_programs(subject.planned, *original, steps).checks)
    if (!c.is_passed) throw std::runtime_error(subject.name + ": not what was planned: " + c.name + " " + c.where);
  for (const Check& c : post.lint(subject.text, subject.context))
    if (!c.is_passed) throw std::runtime_error(subject.name + ": breaks a rule as it is: " + c.name + " " + c.where);
  Random random = Random::stream(seed, "text mutants");
  ++count.programs;
  const auto tokens = tokens_of(subject.text);
  std::vector<std::string> pool;
  for (const TextToken& t : tokens) pool.push_back(subject.text.files[t.file].bytes.substr(t.begin, t.end - t.begin));
  std::size_t n = random.below(choice.every);
  for (std::size_t k = 0; k < tokens.size(); ++k) {
    if (n++ % choice.every != 0) continue;
    ++count.tokens;
    const TextToken& t = tokens[k];
    const std::string& token = pool[k];
    std::vector<std::string> changes = choice.is_all_kinds ? every_change_of(token, pool, random) : changes_of(token, random);
    if (!choice.is_all_kinds) changes = {changes[random.below(changes.size())]};
    for (const std::string& change : changes) {
      ProgramText mutant = subject.text;
      mutant.files[t.file].bytes.replace(t.begin, t.end - t.begin, change);
      ++count.mutants;
      const auto back = post.read(mutant, subject.context);
      if (!back) {
        ++count.by_reader;
        continue;
      }
      bool is_linted = false;
      for (const Check& c : post.lint(mutant, subject.context)) is_linted |= !c.is_passed;
      if (is_linted) {
        ++count.by_rules;
        continue;
      }
      const bool is_same = compare_programs(subject.planned, *back, steps).is_ok();
      bool is_replayed_ok = true;
      const bool is_unmoved = is_same && compare_programs(*original, *back, unmoved).is_ok();
      if (subject.is_replayed_ok && !is_unmoved && (count.replayed < choice.replays_at_most || is_same)) {
        ++count.replayed;
        is_replayed_ok = subject.is_replayed_ok(*back);
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
      const std::string language(name_of(post.language)), before = line_around(subject.text.files[t.file].bytes, t.begin);
      const std::string now = language + ": " + before + "  ->  " + line_around(mutant.files[t.file].bytes, t.begin);
      const bool says_the_same = to_bytes(*back) == original_bytes;
      count.within_rounding += !says_the_same;
      std::string why = harmless(post.language, before, token, change);
      if (why.empty() && !says_the_same) why = "within half the last digit of the plan";
      if (why.empty()) {
        count.unexplained.push_back(subject.name + " " + now);
        continue;
      }
      why = language + ": " + (says_the_same ? "says the same: " : "moves within rounding: ") + why;
      if (count.harmless[why]++ == 0) count.example[why] = now;
    }
  }
}

inline void print(const MutantCount& c) {
  std::printf("%d programs, %d tokens, %d mutants: reader %d, rules %d, comparison %d, replay alone %d; survive %d, caught %.3f %%\n", c.programs, c.tokens, c.mutants,
              c.by_reader, c.by_rules, c.by_comparison, c.by_replay_alone, c.survivors(), 100.0 * (c.mutants - c.survivors()) / std::max(1, c.mutants));
  std::printf("of %d replayed as items the replay by itself refuses %d; %d survivors move the robot, none by more than half the last digit\n", c.replayed,
              c.by_replay_too + c.by_replay_alone, c.within_rounding);
  for (const auto& [why, n] : c.harmless) std::printf("  %5d %s\n        %s\n", n, why.c_str(), c.example.at(why).c_str());
  for (const std::string& s : c.unexplained) std::printf("  not explained: %s\n", s.c_str());
}

}  // namespace asbuilt::support
