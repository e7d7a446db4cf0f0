# Installs image, filter (with the libraries below it) and metrics with their public headers, as the package
# "lumifold": find_package(lumifold) gives lumifold::image, lumifold::filter and lumifold::metrics. Headers
# keep their paths: #include "filter/methods.h".
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(LUMIFOLD_PUBLIC_HEADERS
  image/check.h image/color.h image/edged_image.h image/exr_io.h image/film_layout.h image/film_source.h
  image/filtered_picture.h
  image/layered_image.h image/layers.h image/parallel.h image/plane.h image/planes.h image/png_io.h
  image/rect.h
  baselines/method_info.h layers/single_picture.h manifold/manifold_filter.h
  blocks.h methods.h
  metrics/metrics.h metrics/ssim.h)
set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/lumifold)

foreach(header ${LUMIFOLD_PUBLIC_HEADERS})
  get_filename_component(folder ${header} DIRECTORY)
  install(FILES ${header}
          DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/lumifold/filter/${folder} COMPONENT filter)
endforeach()
set(LUMIFOLD_INSTALLED image metrics kernels manifold layers edges denoise baselines filter)
foreach(library ${LUMIFOLD_INSTALLED})
  target_include_directories(lumifold_${library} INTERFACE
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/lumifold>)
endforeach()
list(TRANSFORM LUMIFOLD_INSTALLED PREPEND lumifold_ OUTPUT_VARIABLE installed_targets)
install(TARGETS ${installed_targets} EXPORT lumifold
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT filter)
install(EXPORT lumifold NAMESPACE lumifold:: FILE lumifoldTargets.cmake
        DESTINATION ${package_dir} COMPONENT filter)

configure_package_config_file(lumifoldConfig.cmake.in ${CMAKE_CURRENT_BINARY_DIR}/lumifoldConfig.cmake
                              INSTALL_DESTINATION ${package_dir})
write_basic_package_version_file(${CMAKE_CURRENT_BINARY_DIR}/lumifoldConfigVersion.cmake
                                 COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/lumifoldConfig.cmake
              ${CMAKE_CURRENT_BINARY_DIR}/lumifoldConfigVersion.cmake
        DESTINATION ${package_dir} COMPONENT filter)
