// SPDX-License-Identifier: GPL-3.0-or-later
// A program of 100000 points: written, read back, compared, linted, replayed. Beside it in the same run what a program does that only
// takes the text apart (a scan for numbers by from_chars) and one that prints the numbers (snprintf), and the memory that was needed.
#include <sys/resource.h>

#include <charconv>
#include <cstdio>
#include <ctime>

#include "planner/pipeline/posted.hpp"
#include "tests/support/post_programs.hpp"

namespace {

using namespace asbuilt;

template <class F>
double seconds(F&& f) {
  const std::clock_t start = std::clock();  // of the processor: one thread, and other work on the machine does not count
  f();
  return static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
}
double memory_mb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024;
}

}  // namespace

int main() {
  const PostContext context = support::post_context();
  int slow = 0;
  for (const Post& post : posts()) {
    const Program p = support::random_program(17, support::mix_for(post, {.sections = 200, .points = 500, .has_events = false, .has_two_tools = false, .has_new_frames = false}));
    const double before_mb = memory_mb();
    Result<ProgramText> text = ProgramText{};
    Result<Program> back = Program{};
    Verdict same;
    const double write = seconds([&] { text = post.write(p, context); });
    if (!text) return std::printf("%s", support::text_of(text.error()).c_str()), 1;
    const double read = seconds([&] { back = post.read(*text, context); });
    if (!back) return std::printf("%s", support::text_of(back.error()).c_str()), 1;
    const double compare = seconds([&] { same = compare_programs(p, *back, printed_steps(post, context)); });
    double lint = seconds([&] {
      for (const Check& c : post.lint(*text, context))
        if (!c.is_passed) std::printf("%s %s\n", c.name.c_str(), c.where.c_str());
    });
    // the peers: the same bytes scanned for numbers, the same numbers printed
    std::size_t bytes = 0, numbers = 0;
    double sum = 0;
    for (const ProgramFile& f : text->files) bytes += f.bytes.size();
    const double scan = seconds([&] {
      for (const ProgramFile& f : text->files)
        for (const char *c = f.bytes.data(), *end = c + f.bytes.size(); c < end;) {
          double v = 0;
          const auto r = std::from_chars(c, end, v);
          if (r.ec == std::errc()) sum += v, ++numbers, c = r.ptr;
          else ++c;
        }
    });
    char buffer[64];
    const double print = seconds([&] {
      for (std::size_t i = 0; i < numbers; ++i) sum += std::snprintf(buffer, sizeof buffer, "%.4f", static_cast<double>(i) * 0.37);
    });
    const double total = write + read + compare;
    slow += total >= 2;
    std::printf("%-9s %zu instructions, %.1f MB of text: write %.2f s (%.1f x printing), read %.2f s (%.1f x scanning), compare %.2f s, lint %.2f s; written and verified %.2f s, %.0f bytes of memory a byte of text%s%s\n",
                std::string(name_of(post.language)).c_str(), p.instructions.size(), static_cast<double>(bytes) / 1e6, write, write / print, read, read / scan, compare, lint, total,
                (memory_mb() - before_mb) * 1.048576e6 / static_cast<double>(bytes), same.is_ok() ? "" : "  NOT the same", sum == 0.5 ? " " : "");
    for (const Check& c : same.checks)
      if (!c.is_passed) std::printf("  %s %g of %g at %s\n", c.name.c_str(), c.measured, c.limit, c.where.c_str());
  }
  std::printf("greatest memory %.0f MB\n", memory_mb());
  return slow;
}
