//! The functions of wrapped axes and samplers that a wrapper only passes on.

/// Functions of a [`RotationAxis`](crate::RotationAxis) that only pass the call on to the axis in a field:
/// `forward_axis!(axis: identity, check)`.
macro_rules! forward_axis {
    ($inner:ident: $($function:ident),+ $(,)?) => {
        $(forward_axis!(@$function $inner);)+
    };
    (@identity $inner:ident) => {
        fn identity(&self) -> &str {
            self.$inner.identity()
        }
    };
    (@capabilities $inner:ident) => {
        fn capabilities(&self) -> $crate::Capabilities {
            self.$inner.capabilities()
        }
    };
    (@begin_run $inner:ident) => {
        fn begin_run(&mut self) {
            self.$inner.begin_run()
        }
    };
    (@announce $inner:ident) => {
        fn announce(&mut self, stops: &[carved_core::units::Steps]) -> Result<(), $crate::DeviceError> {
            self.$inner.announce(stops)
        }
    };
    (@reference $inner:ident) => {
        fn reference(&mut self, cancel: &$crate::cancel::CancelToken) -> Result<$crate::Achieved, $crate::DeviceError> {
            self.$inner.reference(cancel)
        }
    };
    (@even_motion $inner:ident) => {
        fn even_motion(&self) -> Option<$crate::EvenMotion> {
            self.$inner.even_motion()
        }
    };
    (@move_evenly $inner:ident) => {
        fn move_evenly(
            &mut self,
            target: carved_core::units::Steps,
            steps_per_s: f64,
            begun: &mut dyn FnMut($crate::Begun),
        ) -> Result<$crate::Achieved, $crate::DeviceError> {
            self.$inner.move_evenly(target, steps_per_s, begun)
        }
    };
    (@let_go $inner:ident) => {
        fn let_go(&mut self, cancel: &$crate::cancel::CancelToken) -> Result<(), $crate::DeviceError> {
            self.$inner.let_go(cancel)
        }
    };
    (@linear $inner:ident) => {
        fn linear(&mut self) -> Option<&mut dyn $crate::LinearAxis> {
            self.$inner.linear()
        }
    };
    (@specimen_input $inner:ident) => {
        fn specimen_input(&mut self) -> Option<&mut dyn $crate::SpecimenInput> {
            self.$inner.specimen_input()
        }
    };
    (@outputs $inner:ident) => {
        fn outputs(&mut self) -> Option<&mut dyn $crate::outputs::Outputs> {
            self.$inner.outputs()
        }
    };
    (@check $inner:ident) => {
        fn check(&mut self) -> Result<(), $crate::DeviceError> {
            self.$inner.check()
        }
    };
    (@position $inner:ident) => {
        fn position(&self) -> $crate::Position {
            self.$inner.position()
        }
    };
    (@stop_handle $inner:ident) => {
        fn stop_handle(&self) -> $crate::StopHandle {
            self.$inner.stop_handle()
        }
    };
}

/// Functions of a [`Sampler`](crate::sampler::Sampler) that only pass the call on to the sampler in a field:
/// `forward_sampler!(sampler: look, wash)`.
#[macro_export]
macro_rules! forward_sampler {
    ($inner:ident: $($function:ident),+ $(,)?) => {
        $($crate::forward_sampler!(@$function $inner);)+
    };
    (@waits_for_loader $inner:ident) => {
        fn waits_for_loader(&self) -> bool {
            self.$inner.waits_for_loader()
        }
    };
    (@brings_again $inner:ident) => {
        fn brings_again(&self) -> bool {
            self.$inner.brings_again()
        }
    };
    (@begin_run $inner:ident) => {
        fn begin_run(&mut self) {
            self.$inner.begin_run()
        }
    };
    (@look $inner:ident) => {
        fn look(&mut self, axis: &mut dyn $crate::RotationAxis) -> Result<(), $crate::DeviceError> {
            self.$inner.look(axis)
        }
    };
    (@has_sensor $inner:ident) => {
        fn has_sensor(&self) -> bool {
            self.$inner.has_sensor()
        }
    };
    (@sees_specimen $inner:ident) => {
        fn sees_specimen(&self) -> Option<bool> {
            self.$inner.sees_specimen()
        }
    };
    (@next_well $inner:ident) => {
        fn next_well(
            &mut self,
            upcoming: &$crate::sampler::Upcoming<'_>,
            is_ended: &dyn Fn() -> bool,
        ) -> Result<$crate::sampler::NextWell, $crate::DeviceError> {
            self.$inner.next_well(upcoming, is_ended)
        }
    };
    (@go_on $inner:ident) => {
        fn go_on(
            &mut self,
            axis: &mut dyn $crate::RotationAxis,
            expected: $crate::sampler::Expected<'_>,
            cancel: &$crate::cancel::CancelToken,
        ) -> Result<Option<$crate::sampler::Loaded>, $crate::DeviceError> {
            self.$inner.go_on(axis, expected, cancel)
        }
    };
    (@eject $inner:ident) => {
        fn eject(
            &mut self,
            axis: &mut dyn $crate::RotationAxis,
            well: &str,
            cancel: &$crate::cancel::CancelToken,
        ) -> Result<(), $crate::DeviceError> {
            self.$inner.eject(axis, well, cancel)
        }
    };
    (@wash $inner:ident) => {
        fn wash(
            &mut self,
            axis: &mut dyn $crate::RotationAxis,
            well: &str,
            cancel: &$crate::cancel::CancelToken,
        ) -> Result<(), $crate::DeviceError> {
            self.$inner.wash(axis, well, cancel)
        }
    };
}
