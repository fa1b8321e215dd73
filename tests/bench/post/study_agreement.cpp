// SPDX-License-Identifier: GPL-3.0-or-later
// The dialects of items that `asbuilt batch` emitted: each against the plan, each against each other in base, and the moves that foreign parsers
// see in the same files.
//
//   study_agreement WORK [BATCH.yaml OUT]..     writes WORK/N-ITEM/{cell.json,expected.json,krl,inform,beckhoff} for tests/contract/second_readers.py
#include <cmath>
#include <filesystem>

#include "planner/verify/verify.hpp"
#include "tests/bench/post/emitted.hpp"
#include "tests/support/foreign_case.hpp"

namespace {

using namespace asbuilt;

struct Walk {  // what a program does, in base
  std::vector<Pose<frame::Base, frame::Tool>> poses;
  std::vector<double> feeds_mm_s;
  std::vector<JointVector> joints;
  std::vector<std::string> events;  // with the number of motions before them
  int arcs = 0;
};
Walk walk_of(const Program& p) {
  Walk w;
  std::size_t moves = 0;
  const auto to = [&](const Pose<frame::Base, frame::Tool>& T, double v) { w.poses.push_back(T), w.feeds_mm_s.push_back(v), ++moves; };
  for (const Instruction& i : p.instructions) {
    const std::string at = std::to_string(moves) + " ";
    if (const auto* m = std::get_if<MoveLinear>(&i)) to(m->T_base_tool, m->speed_mm_s);
    if (const auto* m = std::get_if<MoveCircular>(&i)) to(m->T_base_tool, m->speed_mm_s), ++w.arcs;
    if (const auto* m = std::get_if<MoveSpline>(&i)) to(m->T_base_tool, m->speed_mm_s);
    if (const auto* m = std::get_if<MoveJoint>(&i)) w.joints.push_back(m->q_rad), ++moves;
    if (const auto* s = std::get_if<SpindleOn>(&i)) w.events.push_back(at + "spindle " + std::to_string(std::lround(s->rpm / 2)));  // printed to 1 or 1.6 rpm
    if (std::holds_alternative<SpindleOff>(i)) w.events.push_back(at + "spindle off");
    if (const auto* s = std::get_if<SetOutput>(&i)) w.events.push_back(at + "output " + std::to_string(s->output) + (s->value ? " on" : " off"));
    if (const auto* s = std::get_if<Wait>(&i)) w.events.push_back(at + "wait " + std::to_string(std::lround(s->time_s * 100)));
    if (const auto* s = std::get_if<SetTool>(&i)) w.events.push_back(at + "tool " + std::to_string(s->number));
    if (const auto* s = std::get_if<SwitchOn>(&i)) w.events.push_back(at + "on " + std::string(name_of(s->what)) + std::to_string(s->data));
    if (const auto* s = std::get_if<SwitchOff>(&i)) w.events.push_back(at + "off " + std::string(name_of(s->what)) + std::to_string(s->data));
  }
  return w;
}

double measured(const Verdict& v, const char* name) {
  for (const Check& c : v.checks)
    if (c.name == name) return c.measured;
  return NAN;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4 || argc % 2 != 0) return std::fprintf(stderr, "usage: study_agreement WORK [BATCH.yaml OUT]..\n"), 2;
  std::filesystem::remove_all(argv[1]);
  int faults = 0, items = 0;
  std::printf("%-14s %-9s %6s %5s  coordinate mm  angle deg   feed mm/s  joint digits  events\n", "item", "dialect", "moves", "arcs");
  const bool is_read = support::for_each_emitted(argc, argv, 2, [&](const ItemRecord& r, const PostContext& context, const auto& shaped) {
    std::vector<Walk> walks;
    bool is_one_plan = true;  // arcs may lie where one dialect has them and another has not
    for (std::size_t k = 0; k < shaped.size(); ++k) {
      const Post& post = *shaped[k].first;
      const auto back = post.read(r.programs[k].text, context);
      if (!back) {
        std::printf("%s\n", support::text_of(back.error()).c_str());
        ++faults;
        continue;
      }
      const Verdict v = compare_programs(shaped[k].second, *back, printed_steps(post, context));
      faults += !v.is_ok();
      walks.push_back(walk_of(*back));
      is_one_plan &= walk_of(shaped[k].second).arcs == walk_of(shaped[0].second).arcs;
      std::printf("%-14s %-9s %6zu %5d  %.6f       %.7f   %.5f    %.4f        %zu\n", r.item_id.c_str(), std::string(name_of(post.language)).c_str(), walks.back().poses.size() + walks.back().joints.size(),
                  walks.back().arcs, measured(v, "compare.coordinate"), measured(v, "compare.angle"), measured(v, "compare.speed"), measured(v, "compare.joints"), walks.back().events.size());
    }
    ++items;
    for (std::size_t a = 0; a < walks.size() && is_one_plan; ++a)
      for (std::size_t b = a + 1; b < walks.size(); ++b) {
        const Walk &p = walks[a], &q = walks[b];
        const Post &post_p = *shaped[a].first, &post_q = *shaped[b].first;
        double mm = 0, rad = 0, feed = 0, joint = 0;
        bool is_same = p.poses.size() == q.poses.size() && p.joints.size() == q.joints.size() && p.events == q.events;
        for (std::size_t i = 0; is_same && i < p.poses.size(); ++i) {
          mm = std::max(mm, (p.poses[i].p_mm - q.poses[i].p_mm).norm());
          rad = std::max(rad, quat_log(p.poses[i].q.conjugate() * q.poses[i].q).norm());
          feed = std::max(feed, std::abs(p.feeds_mm_s[i] - q.feeds_mm_s[i]));
        }
        for (std::size_t i = 0; is_same && i < p.joints.size(); ++i)
          for (std::size_t k = 0; k < 6; ++k)
            joint = std::max(joint, std::abs(p.joints[i][k] - q.joints[i][k]) / (0.5 * (post_p.joint_step_rad(context)[k] + post_q.joint_step_rad(context)[k])));
        // each is within half its digit of the plan on every axis of its own frame
        is_same &= mm <= std::sqrt(3.0) * 0.5 * (post_p.position_step_mm + post_q.position_step_mm) + 1e-6 && feed <= 0.5 * (post_p.speed_step_mm_s + post_q.speed_step_mm_s) + 1e-6 &&
                   rad <= std::sqrt(3.0) * 0.5 * (post_p.angle_step_rad + post_q.angle_step_rad) && joint <= 1.0001;
        faults += !is_same;
        std::printf("%-14s %s against %s: %.6f mm, %.7f deg, %.5f mm/s, joints %.4f of their digits, events %s\n", r.item_id.c_str(), std::string(name_of(post_p.language)).c_str(),
                    std::string(name_of(post_q.language)).c_str(), mm, deg_from_rad(rad), feed, joint, p.events == q.events ? "the same" : "NOT the same");
      }
    std::vector<ProgramText> texts;
    for (const ReleasedProgram& p : r.programs) texts.push_back(p.text);
    if (is_one_plan)
      support::write_foreign_case(std::filesystem::path(argv[1]) / (std::to_string(items) + "-" + r.item_id), context, context.cell.tools,
                                  shaped.empty() ? *r.program : shaped[0].second, texts);
  });
  std::printf("%d items, %d faults\n", items, faults);
  return is_read && items > 0 && faults == 0 ? 0 : 1;
}
