#include "client/cli/command_line.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

class CommandLineTest : public testing::Test {
 protected:
  CommandLineTest() : command_line_({"draw", "Draw a thing", "draw cup -n 2"}) {
    command_line_.AddArgument("THING", &thing_, "What to draw");
    command_line_.AddWholeNumber("-n,--number", &number_, 1, 9, "How often");
    command_line_.AddSeed("--seed", &seed_, "Key");
    command_line_.AddPositiveNumber("--scale", &scale_, "Factor");
    command_line_.AddText("--name", "NAME", &name_, "Name");
    command_line_.AddAddresses("--server", &server_, "Server");
    command_line_.AddFlag("--json", &json_, "JSON");
  }

  // Text printed to `err` for a wrong command line.
  std::string Complaint(const std::vector<std::string>& arguments) {
    test_.err.str("");
    EXPECT_EQ(command_line_.Parse(arguments, test_.environment), ExitCode::kUsage);
    return test_.err.str().substr(0, test_.err.str().find('\n'));
  }

  TestEnvironment test_;
  CommandLine command_line_;
  std::string thing_;
  int number_ = 1;
  uint64_t seed_ = 0;
  float scale_ = 1;
  std::string name_ = "none";
  std::string server_;
  bool json_ = false;
};

TEST_F(CommandLineTest, NamesTheOptionAndWhatItTakes) {
  EXPECT_EQ(Complaint({"cup", "--number", "10"}),
            "lumifold draw: --number: expected a whole number from 1 to 9; got '10'");
  EXPECT_EQ(Complaint({"cup", "-n", "1.5"}),
            "lumifold draw: --number: expected a whole number from 1 to 9; got '1.5'");
  EXPECT_EQ(Complaint({"cup", "-n", "99999999999999"}),
            "lumifold draw: --number: expected a whole number from 1 to 9; got '99999999999999'");
  EXPECT_EQ(Complaint({"cup", "--seed=18446744073709551616"}),
            "lumifold draw: --seed: expected a whole number from 0 to 18446744073709551615; got "
            "'18446744073709551616'");
  for (const std::string scale : {"0", "-1", "nan", "inf", "1x"}) {
    EXPECT_EQ(Complaint({"cup", "--scale=" + scale}),
              "lumifold draw: --scale: expected a number above 0; got '" + scale + "'");
  }
  for (const std::string server : {"host", ":7700", "host:", "host:65536", "host:+1"}) {
    for (const std::string& list : {server, "a:7700," + server}) {
      EXPECT_EQ(Complaint({"cup", "--server", list}),
                "lumifold draw: --server: '" + server + "' is not HOST:PORT");
    }
  }
}

TEST_F(CommandLineTest, NamesWhatIsMissing) {
  EXPECT_EQ(Complaint({}), "lumifold draw: THING is required");
  EXPECT_EQ(Complaint({"cup", "--name"}), "lumifold draw: --name needs a value");
}

TEST_F(CommandLineTest, NamesWhatItDoesNotKnowBeforeWhatIsMissing) {
  EXPECT_EQ(Complaint({"--nmae", "x"}), "lumifold draw: unknown option --nmae; did you mean '--name'?");
  EXPECT_EQ(Complaint({"--nmae=x"}), "lumifold draw: unknown option --nmae; did you mean '--name'?");
  EXPECT_EQ(Complaint({"cup", "-q"}), "lumifold draw: unknown option -q");
  EXPECT_EQ(Complaint({"cup", "saucer"}), "lumifold draw: unexpected argument 'saucer'");
}

TEST_F(CommandLineTest, KeepsTheDefaultsOfWhatIsNotGiven) {
  EXPECT_EQ(command_line_.Parse({"cup"}, test_.environment), std::nullopt);
  EXPECT_EQ(thing_, "cup");
  EXPECT_EQ(number_, 1);
  EXPECT_EQ(name_, "none");
  EXPECT_FALSE(json_);
}

TEST_F(CommandLineTest, ReadsOptionsBeforeAndAfterArgumentsAndTakesTheLast) {
  const std::vector<std::string> arguments = {"-n3",      "--json",         "--seed",  "18446744073709551615",
                                              "cup",      "--number=4",     "--scale", "0.5",
                                              "--server", "[::1]:80,b:7700"};
  EXPECT_EQ(command_line_.Parse(arguments, test_.environment), std::nullopt);
  EXPECT_EQ(thing_, "cup");
  EXPECT_EQ(number_, 4);
  EXPECT_EQ(seed_, 18446744073709551615u);
  EXPECT_EQ(scale_, 0.5f);
  EXPECT_EQ(server_, "[::1]:80,b:7700");
  EXPECT_TRUE(json_);
}

TEST_F(CommandLineTest, PrintsHelpAsData) {
  EXPECT_EQ(command_line_.Parse({"--help"}, test_.environment), ExitCode::kOk);
  EXPECT_THAT(test_.out.str(), StartsWith("Draw a thing\nUsage: lumifold draw [OPTIONS] THING\n"));
  EXPECT_THAT(test_.out.str(), HasSubstr(kExitCodesHelp));
  EXPECT_EQ(test_.err.str(), "");
}

}  // namespace
}  // namespace lumifold::client
