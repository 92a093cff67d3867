//! Which device draws.

use crate::error::RenderError;
use octree_store::loader::BrickFormat;
use std::sync::{Arc, Mutex};
use wgpu::{Features, InstanceDescriptor, Limits};

/// Which adapter is wanted.
#[derive(Debug, Clone, Default)]
pub struct AdapterChoice {
    /// A part of its name, whatever the case; none for the most powerful.
    pub name: Option<String>,
}

fn instance() -> wgpu::Instance {
    wgpu::Instance::new(InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        ..InstanceDescriptor::new_without_display_handle()
    })
}

/// The names of all adapters.
pub fn adapters() -> Vec<String> {
    let found = pollster::block_on(instance().enumerate_adapters(wgpu::Backends::VULKAN));
    found.iter().map(|adapter| adapter.get_info().name).collect()
}

/// A device that is ready, and what it said went wrong.
#[derive(Debug)]
pub(super) struct Device {
    pub(super) handle: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pub(super) name: String,
    /// Whether it is a program on the processor.
    pub(super) software: bool,
    features: Features,
    errors: Arc<Mutex<Vec<String>>>,
}

impl Device {
    pub(super) fn open(choice: &AdapterChoice) -> Result<Self, RenderError> {
        let found = pollster::block_on(instance().enumerate_adapters(wgpu::Backends::VULKAN));
        let count = found.len();
        let power = |adapter: &wgpu::Adapter| match adapter.get_info().device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Other => 3,
            wgpu::DeviceType::Cpu => 4,
        };
        let wanted = choice.name.as_ref().map(|name| name.to_lowercase());
        let fits = |adapter: &wgpu::Adapter| {
            let name = adapter.get_info().name.to_lowercase();
            wanted.as_ref().is_none_or(|wanted| name.contains(wanted))
        };
        let adapter = found.into_iter().filter(fits).min_by_key(power);
        let Some(adapter) = adapter else {
            return Err(RenderError::NoAdapter { wanted: choice.name.clone(), found: count });
        };
        let info = adapter.get_info();
        let useful = Features::TIMESTAMP_QUERY
            | Features::FLOAT32_FILTERABLE
            | Features::TEXTURE_FORMAT_16BIT_NORM;
        let features = adapter.features() & useful;
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("octavo"),
            required_features: features,
            required_limits: Limits::default(),
            ..Default::default()
        }))
        .map_err(|error| RenderError::Adapter {
            adapter: info.name.clone(),
            reason: error.to_string(),
        })?;
        let errors = Arc::new(Mutex::new(Vec::new()));
        let noted = Arc::clone(&errors);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            if let Ok(mut errors) = noted.lock() {
                errors.push(error.to_string());
            }
        }));
        Ok(Self {
            handle: device,
            queue,
            software: info.device_type == wgpu::DeviceType::Cpu,
            name: info.name,
            features,
            errors,
        })
    }

    pub(super) fn has(&self, feature: Features) -> bool {
        self.features.contains(feature)
    }

    /// What the device has complained of since the last call.
    pub(super) fn check(&self, doing: &'static str) -> Result<(), RenderError> {
        let mut errors = self.errors.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        match errors.drain(..).next() {
            Some(reason) => Err(RenderError::Driver { doing, reason }),
            None => Ok(()),
        }
    }

    /// The format of a texture that holds bricks of this format exactly.
    pub(super) fn pool_format(&self, bricks: BrickFormat) -> wgpu::TextureFormat {
        let sixteen_bits = self.has(Features::TEXTURE_FORMAT_16BIT_NORM);
        match bricks {
            // Software drivers interpolate eight bits in eight bits (Mesa's error is 1/255), sixteen in floats.
            BrickFormat::R8 if !(self.software && sixteen_bits) => wgpu::TextureFormat::R8Unorm,
            BrickFormat::R8 | BrickFormat::R16 if sixteen_bits => wgpu::TextureFormat::R16Unorm,
            _ => wgpu::TextureFormat::R32Float,
        }
    }
}
