#include "client/options/display_options.h"

namespace lumifold::client {

void AddDisplayOptions(CommandLine& command_line, pictures::DisplayOptions* display) {
  command_line.AddText("--view", "VIEW", &display->view,
                       "View transform of a .png or .jpg: standard (default), filmic, agx, neutral, raw, or "
                       "one of $OCIO");
  command_line.Offer("--view", pictures::ViewTransform::Views);
  command_line.AddExposure("--exposure", &display->exposure,
                           "Factor on the radiance of a .png or .jpg, or 'auto' (default 1)");
  command_line.AddWholeNumber("--quality", &display->jpeg_quality, 1, 100, "Of a .jpg (default 92)");
  command_line.AddCheck([display] { return pictures::ViewTransform::Create(display->view).status(); });
}

}  // namespace lumifold::client
