// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/pipeline/stage_run.hpp"

#include <gtest/gtest.h>

#include <new>

#include "tests/unit/pipeline/worker.hpp"

namespace asbuilt {
namespace {

struct Toy {
  int value = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("value", s.value);
  }
};

struct Runs {
  test::TemporaryFolder folder;
  ItemOptions options{folder.path, {}, {}, "code-1", ""};
  std::vector<StageEvent> events;
  Watch watch = [this](const StageEvent& e) { events.push_back(e); };
  int calls = 0;

  /// One stage of a new run of the same item.
  ItemRecord once(const StageInputs& given, const std::function<Result<Done<Toy>>()>& body, std::optional<Toy>* out = nullptr) {
    ItemRun run("batch", "item", options, watch);
    std::optional<Toy> toy;
    run.stage<Toy>("toy", "fit", toy, given, [&] { return ++calls, body(); });
    if (out) *out = toy;
    return run.record;
  }
};

const StageInputs kGiven{"recipe", {{"job", "hash-of-job"}}};
Result<Done<Toy>> seven() { return Done<Toy>{{7}, {{Note::Level::note, "toy.note", "said", ""}}}; }

TEST(StageRun, runs_once_and_then_comes_from_the_store) {
  Runs runs;
  std::optional<Toy> first, second;
  runs.once(kGiven, seven, &first);
  const ItemRecord record = runs.once(kGiven, seven, &second);
  EXPECT_EQ(runs.calls, 1);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(second->value, 7);
  EXPECT_EQ(record.notes.size(), 1u);
  EXPECT_EQ(runs.events.back().what, StageEvent::What::from_store);
  EXPECT_FALSE(runs.events.back().key.empty());
}

TEST(StageRun, code_recipe_and_every_input_make_the_key) {
  Runs runs;
  runs.once(kGiven, seven);
  runs.once({"another recipe", kGiven.inputs}, seven);
  EXPECT_EQ(runs.calls, 2);
  runs.once({"recipe", {{"job", "another job"}}}, seven);
  EXPECT_EQ(runs.calls, 3);
  runs.once({"recipe", {{"cloud", "hash-of-job"}}}, seven);
  EXPECT_EQ(runs.calls, 4);
  runs.options.code_tag = "code-2";
  runs.once(kGiven, seven);
  EXPECT_EQ(runs.calls, 5);
  runs.options.code_tag = "code-1";
  runs.once(kGiven, seven);
  EXPECT_EQ(runs.calls, 5);
}

TEST(StageRun, refusals_are_kept_with_the_stage_that_answers) {
  Runs runs;
  const auto no = []() -> Result<Done<Toy>> { return refuse({.code = "toy.no", .measured = 2, .limit = 1}); };
  runs.once(kGiven, no);
  const ItemRecord record = runs.once(kGiven, no);
  EXPECT_EQ(runs.calls, 1);
  EXPECT_EQ(record.status, ItemStatus::refused);
  ASSERT_EQ(record.reasons.size(), 1u);
  EXPECT_EQ(record.reasons[0].code, "toy.no");
  EXPECT_EQ(record.reasons[0].stage, "fit");
  EXPECT_EQ(record.reasons[0].measured, 2);
}

TEST(StageRun, a_refusal_may_name_another_stage) {
  Runs runs;
  const ItemRecord record = runs.once(kGiven, []() -> Result<Done<Toy>> { return refuse({.code = "x", .stage = "input"}); });
  EXPECT_EQ(record.reasons.at(0).stage, "input");
}

TEST(StageRun, crashes_are_failures_and_never_kept) {
  Runs runs;
  const auto bug = []() -> Result<Done<Toy>> {
    must(false, "a promise");
    return seven();
  };
  const auto memory = []() -> Result<Done<Toy>> { throw std::bad_alloc(); };
  const auto other = []() -> Result<Done<Toy>> { throw std::runtime_error("a library's complaint"); };
  EXPECT_EQ(runs.once(kGiven, bug).reasons.at(0).code, "failed.bug");
  EXPECT_EQ(runs.once(kGiven, memory).reasons.at(0).code, "failed.memory");
  const ItemRecord record = runs.once(kGiven, other);
  EXPECT_EQ(record.status, ItemStatus::failed);
  EXPECT_EQ(record.reasons.at(0).code, "failed.exception");
  EXPECT_EQ(record.reasons.at(0).stage, "fit");
  EXPECT_NE(record.reasons.at(0).message.find("a library's complaint"), std::string::npos);
  std::optional<Toy> toy;
  EXPECT_TRUE(runs.once(kGiven, seven, &toy).reasons.empty());
  EXPECT_TRUE(toy.has_value());
  EXPECT_EQ(runs.calls, 4);
}

TEST(StageRun, a_later_refusal_does_not_hide_a_failure) {
  Runs runs;
  ItemRun run("batch", "item", runs.options, runs.watch);
  std::optional<Toy> toy;
  run.stage<Toy>("toy", "fit", toy, kGiven, []() -> Result<Done<Toy>> { throw std::runtime_error("x"); });
  run.refuse_item("post", {{.code = "post.no"}});
  EXPECT_EQ(run.record.status, ItemStatus::failed);
  EXPECT_EQ(run.record.reasons.size(), 2u);
}

TEST(StageRun, an_input_without_a_name_is_never_kept) {
  Runs runs;
  runs.once({"recipe", {{"files", ""}}}, seven);
  runs.once({"recipe", {{"files", ""}}}, seven);
  EXPECT_EQ(runs.calls, 2);
}

TEST(StageRun, time_and_memory_are_measured_by_stage) {
  Runs runs;
  const ItemRecord record = runs.once(kGiven, [] {
    const std::vector<char> big(64 << 20, 1);
    volatile char sink = big[12345];
    (void)sink;
    return seven();
  });
  EXPECT_GE(record.timing_s.at("toy"), 0);
  EXPECT_GT(record.peak_memory_mib.at("toy"), 64);
}

}  // namespace
}  // namespace asbuilt
