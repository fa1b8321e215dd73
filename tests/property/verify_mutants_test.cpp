// SPDX-License-Identifier: GPL-3.0-or-later
// The verifier is itself verified: hundreds of programs with one thing made wrong, drawn at random; each has to be refused by the replay of
// the item, or be named as different from the plan. A mutant that changes nothing of what the machine does is not one.
#include <gtest/gtest.h>

#include "planner/base/random.hpp"
#include "planner/verify/verify.hpp"
#include "tests/unit/verify/item.hpp"

namespace asbuilt {
namespace {

using testing::box_item;
using testing::Item;

std::vector<std::size_t> indices_of_linear(const Program& p) {
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < p.instructions.size(); ++i)
    if (std::holds_alternative<MoveLinear>(p.instructions[i])) out.push_back(i);
  return out;
}

Eigen::Quaterniond with_a_negated(const Eigen::Quaterniond& q) {
  const Mat3 r = q.toRotationMatrix();
  const double b = std::atan2(-r(2, 0), std::hypot(r(0, 0), r(1, 0)));
  return quat_from_zyx(-std::atan2(r(1, 0), r(0, 0)), b, std::atan2(r(2, 1), r(2, 2)));
}

struct Mutant {
  std::string what;
  Program program;
  bool is_seen_by_replay = true;  // the replay alone has to see it; otherwise the comparison
};

Mutant mutate(const Program& good, int kind, Random& random) {
  Mutant m{"", good, true};
  auto& code = m.program.instructions;
  const auto linear = indices_of_linear(good);
  const std::size_t cuts = linear.size() - 2;  // without approach and retract
  const auto pick = [&]() -> MoveLinear& { return std::get<MoveLinear>(code[linear[1 + random.below(cuts)]]); };
  const auto erase = [&](auto&& is) {
    std::vector<std::size_t> all;
    for (std::size_t i = 0; i < code.size(); ++i)
      if (is(code[i])) all.push_back(i);
    code.erase(code.begin() + static_cast<std::ptrdiff_t>(all[random.below(all.size())]));
  };
  switch (kind) {
    case 0: {
      const std::size_t k = 1 + random.below(cuts - 1);
      std::swap(code[linear[k]], code[linear[k + 1]]);
      m.what = "two points swapped at " + std::to_string(k);
      break;
    }
    case 1: {
      const int axis = static_cast<int>(random.below(3));
      pick().T_base_tool.p_mm[axis] += random.uniform() < 0.5 ? 1 : -1;
      m.what = "1 mm along " + std::to_string(axis);
      break;
    }
    case 2: {
      const std::size_t k = 1 + random.below(cuts);
      code.erase(code.begin() + static_cast<std::ptrdiff_t>(linear[k]));
      m.what = "block removed at " + std::to_string(k);
      break;
    }
    case 3: pick().speed_mm_s *= 10; m.what = "ten times the speed"; break;
    case 4: erase([](const Instruction& i) { return std::holds_alternative<SpindleOn>(i); }); m.what = "spindle never on"; break;
    case 5: erase([](const Instruction& i) { return std::holds_alternative<SpindleOff>(i); }); m.what = "spindle never off"; break;
    case 6:
      for (Instruction& i : code)
        if (auto* x = std::get_if<MoveLinear>(&i)) x->T_base_tool.q = with_a_negated(x->T_base_tool.q);
      m.what = "sign of A";
      break;
    case 7:
      for (Instruction& i : code)
        if (auto* x = std::get_if<MoveJoint>(&i))
          for (double& q : x->q_rad) q = random.below(2) ? deg_from_rad(q) : rad_from_deg(q);
      m.what = "degrees and radians";
      break;
    case 8: std::get<SetTool>(code[0]).number = 2; m.what = "wrong tool number"; break;
    case 9: std::get<SetTool>(code[0]).T_flange_tool.p_mm[static_cast<int>(random.below(3))] += 1; m.what = "wrong tool"; break;
    case 10: std::get<SetFrame>(code[1]).T_base_work.p_mm[static_cast<int>(random.below(3))] += 0.1; m.what = "wrong frame"; break;
    case 11: erase([](const Instruction& i) { return std::holds_alternative<MoveJoint>(i); }); m.what = "joint move removed"; break;
    case 12: pick().T_base_tool.p_mm = -pick().T_base_tool.p_mm; m.what = "sign of a point"; break;
    case 13: pick().speed_mm_s *= 60; m.what = "per minute for per second"; break;
    case 14: {
      for (Instruction& i : code)
        if (auto* x = std::get_if<SpindleOn>(&i)) x->rpm *= random.below(2) ? 0.1 : 10;
      m.what = "spindle speed";
      break;
    }
    case 15: {
      const std::size_t k = 1 + random.below(cuts);
      code.insert(code.begin() + static_cast<std::ptrdiff_t>(linear[k]), SpindleOff{});
      m.what = "spindle off in the cut";
      break;
    }
    case 16: {
      std::get<MoveLinear>(code[linear[1 + random.below(cuts)]]).T_base_tool.q = quat_exp(Vec3(random.normal(), random.normal(), random.normal()));
      m.what = "any orientation";
      break;
    }
    case 17: std::reverse(code.begin() + static_cast<std::ptrdiff_t>(linear[1]), code.begin() + static_cast<std::ptrdiff_t>(linear[cuts])); m.what = "backward"; break;
    case 18: {
      std::vector<std::size_t> all;
      for (std::size_t i = 0; i < code.size(); ++i)
        if (std::holds_alternative<MoveJoint>(code[i])) all.push_back(i);
      auto& x = std::get<MoveJoint>(code[all[random.below(all.size())]]);
      x.q_rad[random.below(6)] += random.uniform() < 0.5 ? 0.02 : -0.02;
      m.what = "joint off by a degree";
      m.is_seen_by_replay = false;  // a place above the part is as good as another: only the comparison knows
      break;
    }
    case 19: {
      for (std::size_t i = 0; i < code.size(); ++i)
        if (auto* x = std::get_if<Wait>(&code[i])) x->time_s = 0;
      m.what = "no time for the spindle";
      m.is_seen_by_replay = false;
      break;
    }
    default: pick().speed_mm_s += 0.1; m.what = "a tenth faster"; break;
  }
  return m;
}

TEST(VerifyMutants, every_one_is_refused) {
  const Item item = box_item();
  ASSERT_TRUE(verify_item(item.world.job, item.world.location, item.world.features, item.world.burrs, item.path, item.program).is_ok());
  Random random = Random::stream(11, "mutants");
  int survivors = 0, total = 0;
  for (int round = 0; round < 2; ++round)
    for (int kind = 0; kind <= 20; ++kind) {
      const Mutant m = mutate(item.program, kind, random);
      ++total;
      const bool is_same = compare_programs(item.program, m.program, {.speed_mm_s = 0.1}).is_ok();
      EXPECT_FALSE(is_same) << m.what;
      if (!m.is_seen_by_replay) continue;
      const Verdict v = verify_item(item.world.job, item.world.location, item.world.features, item.world.burrs, item.path, m.program);
      EXPECT_FALSE(v.is_ok()) << m.what;
      survivors += v.is_ok();
    }
  EXPECT_EQ(survivors, 0);
  EXPECT_GE(total, 40);
}

}  // namespace
}  // namespace asbuilt
